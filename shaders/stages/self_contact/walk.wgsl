// Lists, for each leaf of the tree, the leaves whose triangles may meet its own. A workgroup descends the tree for a
// leaf, one level after another, and tests as many nodes at once as it has invocations.

// Number of nodes of a level that a workgroup holds. If more may meet the leaf, one invocation descends alone.
const HELD: u32 = 1024u;
// The cosine and the excess angle [rad] below which connected cloth does not meet itself: `src/contact/tree.rs`.
const UPRIGHT: f32 = 0.64;
const MOST_EXCESS: f32 = 0.6;

// The nodes of two levels in turn that may meet the leaf, in ascending order; which of some children may, a bit each; how
// many there are; and how many of the leaves found come before the own.
var<workgroup> held: array<array<u32, HELD>, 2>;
var<workgroup> meeting: array<atomic<u32>, 2>;
var<workgroup> total: u32;
var<workgroup> lower: atomic<u32>;

// Whether two nodes of a level, or a node and itself, certainly do not meet: `Tree::is_clear`.
fn is_clear(a: u32, b: u32) -> bool {
    if a != b && are_apart(box_of_node(a), box_of_node(b)) {
        return true;
    }
    let more = select(0.0, number(about.excess + b), a != b);
    if number(about.excess + a) + more >= MOST_EXCESS {
        return false;
    }
    let low = min(nodes[a].normal_low, nodes[b].normal_low);
    let high = max(nodes[a].normal_high, nodes[b].normal_high);
    let axis = low + high;
    let least = dot(min(low * axis, high * axis), vec3f(1.0));
    if !(least > 0.0 && least * least > UPRIGHT * UPRIGHT * square(axis)) {
        return false;
    }
    return a == b || is_beside(a, b);
}

fn is_beside(a: u32, b: u32) -> bool {
    // Without an early return, the loads need not wait for each other.
    let end = table[about.beside + a + 1u];
    var is_one = false;
    for (var k = table[about.beside + a]; k < end; k++) {
        is_one |= table[k] == b;
    }
    return is_one;
}

// The ancestor of a leaf on a level, or the leaf itself.
fn node_above(leaf: u32, level: u32) -> u32 {
    return ((1u << about.depth) + leaf) >> (about.depth - level);
}

// Adds entry number `k` to the list of a leaf, if there is room for it.
fn list(leaf: u32, k: u32, other: u32) {
    if k < about.room_of_leaf {
        beside[list_of(leaf) + 2u + k] = other;
    }
    if other < leaf {
        atomicAdd(&lower, 1u);
    }
}

// A bit for each lower lane.
fn lanes_before(lane: u32) -> vec2u {
    let here = (1u << (lane % 32u)) - 1u;
    return select(vec2u(0xffffffffu, here), vec2u(here, 0u), lane < 32u);
}

@compute @workgroup_size(WORKGROUP)
fn walk(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let leaf = group.x + group.y * groups.x;
    if lane == 0u {
        // Other leaves may have found that there is no room; the longest list counts.
        let goes_on = (atomicLoad(&known.status.stopped) & ~NO_ROOM) == 0u;
        total = u32(known.status.detects != 0u && goes_on && leaf < (1u << about.depth));
        atomicStore(&lower, 0u);
        held[0][0] = 0u;
    }
    let starts_here = workgroupUniformLoad(&total);
    var count = starts_here;
    var found = 0u;
    var turn = 0u;
    // The children of the held nodes are tested; those of node 0 are nothing and the root.
    for (var level = 0u; level <= about.depth && count > 0u && count <= HELD; level++) {
        let own = node_above(leaf, level);
        let is_last = level == about.depth;
        var next = 0u;
        for (var first = 0u; first < 2u * count; first += WORKGROUP) {
            let k = first + lane;
            var node = 0u;
            if k < 2u * count {
                node = 2u * held[turn][k / 2u] + k % 2u;
            }
            let meets = node != 0u && !is_clear(own, node);
            if lane < 2u {
                atomicStore(&meeting[lane], 0u);
            }
            workgroupBarrier();
            if meets {
                atomicOr(&meeting[lane / 32u], 1u << (lane % 32u));
            }
            workgroupBarrier();
            let all = vec2u(atomicLoad(&meeting[0]), atomicLoad(&meeting[1]));
            let before = countOneBits(all & lanes_before(lane));
            let place = next + before.x + before.y;
            if meets && is_last {
                list(leaf, place, node - (1u << about.depth));
            } else if meets && place < HELD {
                held[1u - turn][place] = node;
            }
            let bits = countOneBits(all);
            next += bits.x + bits.y;
            workgroupBarrier();
        }
        turn = 1u - turn;
        if lane == 0u {
            total = next;
        }
        count = select(workgroupUniformLoad(&total), 0u, is_last);
        found = next;
    }
    if lane == 0u && starts_here > 0u {
        if count > HELD {
            found = descend_alone(leaf);
        }
        beside[list_of(leaf)] = found;
        beside[list_of(leaf) + 1u] = atomicLoad(&lower);
        if found > about.room_of_leaf {
            atomicMax(&known.status.needed_of_leaf, found);
            atomicOr(&known.status.stopped, NO_ROOM);
        }
    }
}

// The same in depth-first order, with nothing held. Returns the number of leaves.
fn descend_alone(leaf: u32) -> u32 {
    atomicStore(&lower, 0u);
    var count = 0u;
    var n = 1u;
    while n != 0u {
        let level = firstLeadingBit(n);
        if is_clear(node_above(leaf, level), n) {
            n = after(n);
        } else if level < about.depth {
            n = 2u * n;
        } else {
            list(leaf, count, n - (1u << about.depth));
            count++;
            n = after(n);
        }
    }
    return count;
}

// The next node in depth-first order that is not below `n`; 0 after the last.
fn after(n: u32) -> u32 {
    let next = (n + 1u) >> firstTrailingBit(n + 1u);
    return select(next, 0u, next == 1u);
}
