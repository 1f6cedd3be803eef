// Descends the trees of bounds, a workgroup for each leaf of the cloth: to itself and to those leaves of the cloth after it
// whose triangles may meet its own, and to those of mesh colliders. After a leaf comes half of all leaves, and then it comes
// after the others: thus each pair is found once, and each leaf has as many to find. Mesh colliders do not meet each other.

const LANES: u32 = 128u;

// The excess angle [rad] below which connected cloth does not meet itself if its normals are within a cone of `CONE_COSINE`:
// `src/contact/detection/tree/mod.rs`.
const MAX_EXCESS: f32 = 0.6;
// Number of nodes that can be held. With the last `LEVELS` of these places left, one node is replaced by its children at a
// time, which needs at most a place for each level.
const HELD: u32 = 1024u;
const LEVELS: u32 = 32u;
// Number of leaves that are met, or more, before they are noted; and limit on it: `LANES` more.
const MET: u32 = 64u;
const MAX_MET: u32 = 192u;

// The nodes that may meet the leaf and whose children are not tested yet, the last ones first; and the leaves.
var<workgroup> held: array<u32, HELD>;
var<workgroup> held_count: atomic<u32>;
var<workgroup> met: array<u32, MAX_MET>;
var<workgroup> met_count: atomic<u32>;
var<workgroup> first_met: u32;

// Whether two nodes of a level, or a node and itself, certainly do not meet: `Tree::is_clear`.
fn is_clear(a: u32, b: u32) -> bool {
    if a != b && are_apart(box_of_node(a), box_of_node(b)) {
        return true;
    }
    let more = select(0.0, number(contact_params.excess + b), a != b);
    if number(contact_params.excess + a) + more >= MAX_EXCESS {
        return false;
    }
    let low = min(nodes[a].normal_low, nodes[b].normal_low);
    let high = max(nodes[a].normal_high, nodes[b].normal_high);
    return in_one_cone(Normals(low, high)) && (a == b || is_beside(a, b));
}

fn is_beside(a: u32, b: u32) -> bool {
    // Without an early return, the loads need not wait for each other.
    let end = table[contact_params.beside + a + 1u];
    var is_one = false;
    for (var k = table[contact_params.beside + a]; k < end; k++) {
        is_one |= table[k] == b;
    }
    return is_one;
}

// Whether the leaf itself, or one after it, is below a node on a level, or is that node.
fn is_after(leaf: u32, node: u32, level: u32) -> bool {
    let below = contact_params.depth - level;
    let ahead = ((node << below) - leaf) & (leaves() - 1u);
    let half = leaves() / 2u;
    // Either of two leaves could be after the other if half of all are between them.
    let is_tie = below == 0u && ahead == half && (node - leaves()) < leaf;
    return (ahead <= half && !is_tie) || ahead + (1u << below) > leaves();
}

// Returns the number of nodes that are held.
fn begin_descent(lane: u32) -> u32 {
    let of_cloth = select(0u, 1u << first_level(contact_params.depth), contact_params.has_self_contact != 0u);
    let of_meshes = select(0u, 1u << first_level(contact_params.mesh_depth), contact_params.mesh_leaves > 0u);
    if lane < of_cloth {
        held[lane] = select(of_cloth, 0u, contact_params.depth == 0u) + lane;
    }
    if lane < of_meshes {
        held[of_cloth + lane] = 2u * leaves() + select(of_meshes, 0u, contact_params.mesh_depth == 0u) + lane;
    }
    if lane == 0u {
        atomicStore(&met_count, 0u);
    }
    workgroupBarrier();
    return of_cloth + of_meshes;
}

// Whether the leaf meets a node of the cloth.
fn meets(leaf: u32, node: u32, level: u32) -> bool {
    return is_after(leaf, node, level) && !is_clear((leaves() + leaf) >> (contact_params.depth - level), node);
}

// Whether the leaf meets a node of mesh colliders.
fn meets_mesh(leaf: u32, node: u32) -> bool {
    return !are_apart(box_of_node(leaves() + leaf), box_of_node(node));
}

// Holds a node whose children are to be tested, or meets the leaf that it is.
fn keep(node: u32, is_leaf: bool, leaf: u32) {
    if is_leaf {
        met[atomicAdd(&met_count, 1u)] = leaf;
    } else {
        held[atomicAdd(&held_count, 1u)] = node;
    }
}

// Numbers of nodes that are held and of leaves that were met.
struct Reached {
    held: u32,
    met: u32,
}

// Replaces as many of the `count` held nodes as there are invocations for by those of their children that may meet the
// leaf. Of these, leaves are met.
fn replace(leaf: u32, count: u32, lane: u32) -> Reached {
    let parents = min(min(count, LANES / 2u), max(HELD - LEVELS, count + 1u) - count);
    var before = 0u;
    // Its number in its tree; 0 is none.
    var number = 0u;
    if lane < 2u * parents {
        let parent = held[count - parents + lane / 2u];
        before = before_tree(parent);
        number = 2u * (parent - before) + lane % 2u;
    }
    if lane == 0u {
        atomicStore(&held_count, count - parents);
    }
    workgroupBarrier();
    if number != 0u {
        let level = firstLeadingBit(number);
        if before == 0u && meets(leaf, number, level) {
            keep(number, level == contact_params.depth, number - leaves());
        }
        if before > 0u && meets_mesh(leaf, before + number) {
            keep(before + number, level == contact_params.mesh_depth, leaves() + number - contact_params.mesh_leaves);
        }
    }
    workgroupBarrier();
    let both = broadcast((atomicLoad(&met_count) << 16u) | atomicLoad(&held_count), lane);
    return Reached(both & 0xffffu, both >> 16u);
}

// Notes the leaves that were met. Returns false if there are too many.
fn note_met(leaf: u32, count: u32, lane: u32) -> bool {
    if lane == 0u {
        first_met = atomicAdd(&contact_state.status.leaf_pairs, count);
        demand_space(first_met + count, LEAF_PAIRS);
        atomicStore(&met_count, 0u);
    }
    let first = workgroupUniformLoad(&first_met);
    for (var k = lane; k < count; k += LANES) {
        if first + k < LEAF_PAIRS * space() {
            scratch[first + k] = vec2u(leaf, met[k]);
        }
    }
    workgroupBarrier();
    return first < MAX_PAIRS;
}

@compute @workgroup_size(LANES)
fn descend(me: Invocation, group: Workgroup) {
    let leaf = number_of(group);
    if broadcast(u32(goes_on() && leaf < leaves()), me.lane) == 0u {
        return;
    }
    var reached = Reached(begin_descent(me.lane), 0u);
    while reached.held > 0u {
        reached = replace(leaf, reached.held, me.lane);
        let is_full = reached.held == 0u || reached.met >= MET;
        if is_full && reached.met > 0u && !note_met(leaf, reached.met, me.lane) {
            return;
        }
    }
}
