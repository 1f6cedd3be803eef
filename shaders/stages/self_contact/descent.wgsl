// Descends the tree of bounds for a leaf, to itself and to those leaves after it whose triangles may meet its own. After
// a leaf comes half of all leaves, and then it comes after the others: thus each pair is found once, and each leaf has as
// many to find.

// The cosine and the excess angle [rad] below which connected cloth does not meet itself: `src/contact/tree.rs`.
const UPRIGHT: f32 = 0.64;
const MOST_EXCESS: f32 = 0.6;
// The level whose nodes a descent begins with, unless the leaves are above it.
const FIRST_LEVEL: u32 = 6u;
// Number of nodes that can be held. With the last few of these places left, one node is replaced by its children at a
// time, which needs at most a place for each level.
const HELD: u32 = 1024u;
const LEVELS: u32 = 32u;
// Number of leaves that are met, or more, before they are compared; and limit on it: `LANES` more.
const MET: u32 = 64u;
const MOST_MET: u32 = 192u;

// The nodes that may meet the leaf and whose children are not tested yet, the last ones first; and the leaves.
var<workgroup> held: array<u32, HELD>;
var<workgroup> held_count: atomic<u32>;
var<workgroup> met: array<u32, MOST_MET>;
var<workgroup> met_count: atomic<u32>;

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

fn leaves() -> u32 {
    return 1u << about.depth;
}

// Whether the leaf itself, or one after it, is below a node on a level, or is that node.
fn is_after(leaf: u32, node: u32, level: u32) -> bool {
    let below = about.depth - level;
    let ahead = ((node << below) - leaf) & (leaves() - 1u);
    let half = leaves() / 2u;
    // Either of two leaves could be after the other if half of all are between them.
    let is_tie = below == 0u && ahead == half && (node - leaves()) < leaf;
    return (ahead <= half && !is_tie) || ahead + (1u << below) > leaves();
}

fn begin_descent(lane: u32) {
    let level = min(FIRST_LEVEL, max(about.depth, 1u) - 1u);
    // Node 0 is not in the tree; one of its children is the root.
    let first = select(1u << level, 0u, about.depth == 0u);
    if lane < (1u << level) {
        held[lane] = first + lane;
    }
    if lane == 0u {
        atomicStore(&held_count, 1u << level);
        atomicStore(&met_count, 0u);
    }
    workgroupBarrier();
}

// Replaces as many held nodes as there are invocations for by those of their children that may meet the leaf. Of these,
// leaves are met.
fn descend(leaf: u32, lane: u32) {
    let count = broadcast(atomicLoad(&held_count), lane);
    let parents = min(min(count, LANES / 2u), max((HELD - count) / LEVELS, 1u));
    var node = 0u;
    if lane < 2u * parents {
        node = 2u * held[count - parents + lane / 2u] + lane % 2u;
    }
    workgroupBarrier();
    if lane == 0u {
        atomicStore(&held_count, count - parents);
    }
    workgroupBarrier();
    if node != 0u {
        let level = firstLeadingBit(node);
        if is_after(leaf, node, level) && !is_clear((leaves() + leaf) >> (about.depth - level), node) {
            if level == about.depth {
                met[atomicAdd(&met_count, 1u)] = node - leaves();
            } else {
                held[atomicAdd(&held_count, 1u)] = node;
            }
        }
    }
    workgroupBarrier();
}
