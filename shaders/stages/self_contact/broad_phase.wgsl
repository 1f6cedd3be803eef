// The broad phase compares the boxes of the features of leaves that meet. Each invocation has a feature of one leaf, and
// compares it with those of the other leaf, which are kept in workgroup memory.

const COMPARERS: u32 = 256u;

// Boxes of the other leaf's features: one for each invocation.
var<workgroup> others: array<StoredBox, 256>;
// Numbers of candidates of either kind that a workgroup finds, and where they begin.
var<workgroup> found: array<atomic<u32>, 2>;
var<workgroup> first_found: array<u32, 2>;

// The features of a leaf. They are numbered: vertices, triangles, edges.
struct Leaf {
    vertices: Features,
    triangles: Features,
    edges: Features,
}

fn leaf_of(leaf: u32) -> Leaf {
    return Leaf(
        features_of(contact_params.leaf_vertices, leaf),
        features_of(contact_params.leaf_triangles, leaf),
        features_of(contact_params.leaf_edges, leaf),
    );
}

// The place of the box of feature number `k` of a leaf, or `NONE`.
fn place_of_box(leaf: Leaf, k: u32) -> u32 {
    let triangle = k - leaf.vertices.count;
    let edge = triangle - leaf.triangles.count;
    if k < leaf.vertices.count {
        return box_of_first_vertex() + leaf.vertices.first + k;
    }
    if triangle < leaf.triangles.count {
        return leaf.triangles.first + triangle;
    }
    return select(NONE, contact_params.box_edges + leaf.edges.first + edge, edge < leaf.edges.count);
}

// The features of another leaf that a feature is compared with, and the number of the first of them in that leaf. `own` is
// the feature's place in the list of its kind, and `hits` has a bit for each of the others, at most 36, whose box meets its
// own.
struct Comparison {
    kind: u32,
    own: u32,
    others: Features,
    number: u32,
    hits: vec2u,
}

const VERTEX: u32 = 0u;
const TRIANGLE: u32 = 1u;
const EDGE: u32 = 2u;

// The comparison of feature number `k` of a leaf. A triangle is not compared with the vertices of its own leaf, because these
// are compared with it, and an edge only with those after it.
fn comparison(leaf: Leaf, other: Leaf, is_same: bool, k: u32) -> Comparison {
    let triangle = k - leaf.vertices.count;
    let edge = triangle - leaf.triangles.count;
    if k < leaf.vertices.count {
        return Comparison(VERTEX, leaf.vertices.first + k, other.triangles, other.vertices.count, vec2u());
    }
    if triangle < leaf.triangles.count {
        let vertices = Features(other.vertices.first, select(other.vertices.count, 0u, is_same));
        return Comparison(TRIANGLE, leaf.triangles.first + triangle, vertices, 0u, vec2u());
    }
    let skipped = select(0u, edge + 1u, is_same);
    let edges = Features(other.edges.first + skipped, max(other.edges.count, skipped) - skipped);
    let number = other.vertices.count + other.triangles.count + skipped;
    return Comparison(EDGE, leaf.edges.first + edge, edges, number, vec2u());
}

// Compares a box with consecutive ones in workgroup memory.
fn meeting(here: Box, first: u32, count: u32) -> vec2u {
    var hits = vec2u();
    for (var k = 0u; k < count; k++) {
        let hit = u32(!are_apart(here, unpacked(others[first + k])));
        if k < 32u {
            hits.x |= hit << k;
        } else {
            hits.y |= hit << (k - 32u);
        }
    }
    return hits;
}

// The candidate of a comparison's own feature and another: first the vertex and then the triangle, or the edge with the
// lower index and then the other.
fn candidate(all: Comparison, other: u32) -> vec2u {
    if all.kind == EDGE {
        return vec2u(contact_params.all_vertices + min(all.own, other), max(all.own, other));
    }
    if all.kind == VERTEX {
        return vec2u(table[contact_params.order + all.own], other);
    }
    return vec2u(table[contact_params.order + other], all.own);
}

@compute @workgroup_size(COMPARERS)
fn compare(me: Invocation, group: Workgroup) {
    if me.lane == 0u {
        total = select(0u, min(atomicLoad(&contact_state.status.leaf_pairs), LEAF_PAIRS * space()), goes_on());
    }
    let end = workgroupUniformLoad(&total);
    // Whole pairs of leaves.
    let pairs_here = COMPARERS / contact_params.features;
    let mine = me.lane / contact_params.features;
    for (var first = number_of(group) * pairs_here; first < end; first += group.all.x * group.all.y * pairs_here) {
        if me.lane < 2u {
            atomicStore(&found[me.lane], 0u);
        }
        var all = Comparison();
        var place = NONE;
        if mine < pairs_here && first + mine < end {
            let both = scratch[first + mine];
            let other = leaf_of(both.y);
            let leaf = leaf_of(both.x);
            place = place_of_box(leaf, me.lane % contact_params.features);
            all = comparison(leaf, other, both.x == both.y, me.lane % contact_params.features);
            let place_of_other = place_of_box(other, me.lane % contact_params.features);
            if place_of_other != NONE {
                others[me.lane] = boxes[place_of_other];
            }
        }
        workgroupBarrier();
        if place != NONE {
            all.hits = meeting(unpacked(boxes[place]), mine * contact_params.features + all.number, all.others.count);
        }
        let is_edge = all.kind == EDGE;
        let count = countOneBits(all.hits.x) + countOneBits(all.hits.y);
        var rank = 0u;
        if count > 0u {
            rank = atomicAdd(&found[u32(is_edge)], count);
        }
        workgroupBarrier();
        if me.lane < 2u {
            reserve(me.lane);
        }
        workgroupBarrier();
        note(all, first_found[u32(is_edge)] + rank);
        // The numbers must not overflow.
        if broadcast(max(first_found[0], first_found[1]), me.lane) > MAX_PAIRS {
            return;
        }
    }
}

// Reserves places for the candidates of a kind.
fn reserve(kind: u32) {
    let more = atomicLoad(&found[kind]);
    if kind == 0u {
        first_found[0] = atomicAdd(&contact_state.status.candidates, more);
    } else {
        first_found[1] = atomicAdd(&contact_state.status.edge_candidates, more);
    }
}

// Writes the candidates of a comparison, from this one of their kind on.
fn note(all: Comparison, first: u32) {
    var index = first;
    for (var hits = all.hits; any(hits != vec2u());) {
        var k = firstTrailingBit(hits.x);
        if hits.x == 0u {
            k = 32u + firstTrailingBit(hits.y);
            hits.y &= hits.y - 1u;
        } else {
            hits.x &= hits.x - 1u;
        }
        if index < CANDIDATES * space() {
            scratch[place_of_candidate(index, all.kind == EDGE)] = candidate(all, all.others.first + k);
        }
        index++;
    }
}
