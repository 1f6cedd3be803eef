// Compares the boxes of the features of leaves that meet. An invocation has a feature of one leaf, and compares it with
// those of the other leaf.

override LANES: u32 = 256u;

// Number of boxes that are compared at once: without branches between them, their loads need not wait for each other.
const AT_ONCE: u32 = 4u;

// Numbers of candidates of either kind that a workgroup finds, and where they begin.
var<workgroup> found: array<atomic<u32>, 2>;
var<workgroup> first_found: array<u32, 2>;

// A feature of one leaf, and those of another that it is compared with, whose numbers are the places of their boxes less
// `before`. `hits` has a bit for each of these, at most 36, whose box meets.
struct Comparison {
    list: u32,
    own: u32,
    others: Features,
    before: u32,
    hits: vec2u,
}

// The comparison of feature number `k` of a leaf: its vertices come first, then triangles, then edges. A triangle is not
// compared with the vertices of its own leaf, because these are compared with it, and an edge only with those after it.
fn comparison(leaf: u32, other: u32, k: u32) -> Comparison {
    let vertices = features_of(about.leaf_vertices, leaf);
    let triangles = features_of(about.leaf_triangles, leaf);
    let edges = features_of(about.leaf_edges, leaf);
    var all = Comparison();
    if k < vertices.count {
        all = Comparison(about.leaf_triangles, vertices.first + k, features_of(about.leaf_triangles, other), 0u, vec2u());
    } else if k < vertices.count + triangles.count && leaf != other {
        let own = triangles.first + k - vertices.count;
        all = Comparison(about.leaf_vertices, own, features_of(about.leaf_vertices, other), box_of_first_vertex(), vec2u());
    } else if k >= vertices.count + triangles.count && k < vertices.count + triangles.count + edges.count {
        let own = edges.first + k - vertices.count - triangles.count;
        all = Comparison(about.leaf_edges, own, features_of(about.leaf_edges, other), about.box_edges, vec2u());
        if leaf == other {
            all.others = Features(own + 1u, edges.first + edges.count - own - 1u);
        }
    }
    return all;
}

// The box of a comparison's own feature.
fn own_box(all: Comparison) -> Box {
    if all.list == about.leaf_triangles {
        return boxes[box_of_first_vertex() + all.own];
    }
    return boxes[all.own + select(0u, about.box_edges, all.list == about.leaf_edges)];
}

fn compared(all: Comparison) -> vec2u {
    var hits = vec2u();
    if all.others.count == 0u {
        return hits;
    }
    let here = own_box(all);
    let first = all.before + all.others.first;
    let last = all.others.count - 1u;
    for (var k = 0u; k <= last; k += AT_ONCE) {
        var few = 0u;
        for (var j = 0u; j < AT_ONCE; j++) {
            let is_apart = are_apart(here, boxes[first + min(k + j, last)]);
            few |= u32(k + j <= last && !is_apart) << j;
        }
        if k < 32u {
            hits.x |= few << k;
        } else {
            hits.y |= few << (k - 32u);
        }
    }
    return hits;
}

// The candidate of a comparison's own feature and another: first the vertex and then the triangle, or the edge with the
// lower index and then the other.
fn candidate(all: Comparison, other: u32) -> vec2u {
    if all.list == about.leaf_edges {
        return vec2u(about.all_vertices + min(all.own, other), max(all.own, other));
    }
    if all.list == about.leaf_triangles {
        return vec2u(table[about.order + all.own], other);
    }
    return vec2u(table[about.order + other], all.own);
}

@compute @workgroup_size(LANES)
fn compare(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if lane == 0u {
        total = select(0u, min(atomicLoad(&known.status.leaf_pairs), LEAF_PAIRS * space()), goes_on());
    }
    let end = workgroupUniformLoad(&total);
    // Whole pairs of leaves.
    let pairs_here = LANES / about.features;
    let mine = lane / about.features;
    for (var first = (group.x + group.y * groups.x) * pairs_here; first < end; first += groups.x * groups.y * pairs_here) {
        if lane < 2u {
            atomicStore(&found[lane], 0u);
        }
        workgroupBarrier();
        var all = Comparison();
        var rank = 0u;
        if mine < pairs_here && first + mine < end {
            let leaf_pair = drafts[first + mine];
            all = comparison(leaf_pair.x, leaf_pair.y, lane % about.features);
            all.hits = compared(all);
        }
        let is_edge = all.list == about.leaf_edges;
        let count = countOneBits(all.hits.x) + countOneBits(all.hits.y);
        if count > 0u {
            rank = atomicAdd(&found[u32(is_edge)], count);
        }
        workgroupBarrier();
        if lane < 2u {
            reserve(lane);
        }
        workgroupBarrier();
        note(all, is_edge, first_found[u32(is_edge)] + rank);
        // The numbers must not overflow.
        if broadcast(max(first_found[0], first_found[1]), lane) > MOST_OF_ALL {
            return;
        }
    }
}

// Reserves places for the candidates of a kind.
fn reserve(kind: u32) {
    let more = atomicLoad(&found[kind]);
    if kind == 0u {
        first_found[0] = atomicAdd(&known.status.candidates, more);
    } else {
        first_found[1] = atomicAdd(&known.status.edge_candidates, more);
    }
}

// Writes the candidates of a comparison, from this one of their kind on.
fn note(all: Comparison, is_edge: bool, first: u32) {
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
            drafts[place_of_candidate(index, is_edge)] = candidate(all, all.others.first + k);
        }
        index++;
    }
}
