// Detection lists the pairs that may come closer than their thickness within some substeps. A workgroup finds those of
// a leaf of the cloth with itself, with the leaves after it and with those of mesh colliders. It compares boxes first, and
// collects the pairs that these do not rule out until there is one for each invocation to measure. The order of the list has no effect on the result.

override LANES: u32 = 128u;

// Limit on the number of pairs. Beyond it, all cloth is in one place.
const MOST_OF_ALL: u32 = 0x10000000u;
// Number of features of another leaf that an invocation compares before the candidates are measured.
const ITEMS: u32 = 12u;
// A candidate is the number of one of the own features, times this, plus the other feature.
const OTHERS: u32 = 0x04000000u;
// Limits on the comparisons that are chosen, at most 3 by each invocation besides fewer than one each from before, and on
// the candidates, at most `ITEMS` of each invocation besides fewer than one each of either kind.
const CHOSEN: u32 = 512u;
const CANDIDATES: u32 = 1792u;

// Consecutive features of a kind.
struct Features {
    first: u32,
    count: u32,
}

// Own features. They are numbered: vertices, triangles, edges.
struct Own {
    vertices: Features,
    triangles: Features,
    edges: Features,
}

var<workgroup> own: Own;
// Comparisons of an own feature with some of another leaf's: the index of the leaf in `met`, the number of the feature in 7
// bits, and in 2 bits from which of the leaf's features on, in units of `ITEMS`.
var<workgroup> chosen: array<u32, CHOSEN>;
var<workgroup> chosen_count: atomic<u32>;
// Those of vertices with triangles fill the array from its start, those of edges from its end.
var<workgroup> candidates: array<u32, CANDIDATES>;
var<workgroup> candidate_counts: array<atomic<u32>, 2>;
var<workgroup> listed_here: atomic<u32>;
var<workgroup> first_listed: u32;
var<workgroup> total: u32;

// The number that the first invocation passes, for all.
fn broadcast(value: u32, lane: u32) -> u32 {
    if lane == 0u {
        total = value;
    }
    return workgroupUniformLoad(&total);
}

// A list of features in the table has the first of each leaf.
fn features_of(list: u32, leaf: u32) -> Features {
    let first = table[list + leaf];
    return Features(first, table[list + leaf + 1u] - first);
}

// The part of a leaf's features that a workgroup handles.
fn share_of(all: Features, part: u32) -> Features {
    let turn = part % about.sharing;
    let first = all.count * turn / about.sharing;
    return Features(all.first + first, all.count * (turn + 1u) / about.sharing - first);
}

fn vertex(place: u32) -> u32 {
    return table[about.order + place];
}

fn are_adjacent(is_edge: bool, c: vec4u) -> bool {
    return c.x == c.z || c.x == c.w || select(c.x == c.y, c.y == c.z || c.y == c.w, is_edge);
}

fn box_of_vertex(v: u32) -> Box {
    let place = place_at(v);
    return box_of(place, place);
}

fn box_of_own(k: u32) -> Box {
    if k < own.vertices.count {
        return box_of_vertex(vertex(own.vertices.first + k));
    }
    let triangle = k - own.vertices.count;
    if triangle < own.triangles.count {
        return boxes[own.triangles.first + triangle];
    }
    return boxes[about.box_edges + own.edges.first + triangle - own.triangles.count];
}

// The list of those features that an own one is compared with.
fn list_for(k: u32) -> u32 {
    if k < own.vertices.count {
        return about.leaf_triangles;
    }
    return select(about.leaf_edges, about.leaf_vertices, k < own.vertices.count + own.triangles.count);
}

// Chooses the comparisons of own feature number `k` with a leaf that was met. A triangle is not compared with the
// vertices of its own leaf, because these are compared with it.
fn choose(k: u32, leaf: u32, index: u32) {
    let list = list_for(k);
    let is_own = list == about.leaf_vertices && met[index] == leaf;
    if is_own || are_apart(box_of_own(k), box_of_node(node_of_leaf(met[index]))) {
        return;
    }
    let count = features_of(list, met[index]).count;
    for (var turn = 0u; ITEMS * turn < count; turn++) {
        chosen[atomicAdd(&chosen_count, 1u)] = (index << 9u) | (k << 2u) | turn;
    }
}

// Whether each of some features, as a bit, has a box that is not apart from this one. A loop of fixed length without branches
// lets the loads of all boxes be under way at once.
fn meeting_vertices(here: Box, first: u32, end: u32) -> u32 {
    var hits = 0u;
    for (var k = 0u; k < ITEMS; k++) {
        let is_apart = are_apart(here, box_of_vertex(vertex(min(first + k, end - 1u))));
        hits |= u32(first + k < end && !is_apart) << k;
    }
    return hits;
}

fn meeting_boxes(here: Box, first: u32, end: u32, before: u32) -> u32 {
    var hits = 0u;
    for (var k = 0u; k < ITEMS; k++) {
        let is_apart = are_apart(here, boxes[before + min(first + k, end - 1u)]);
        hits |= u32(first + k < end && !is_apart) << k;
    }
    return hits;
}

// Collects the pairs of a comparison whose boxes meet.
fn collect(comparison: u32, leaf: u32) {
    let other_leaf = met[comparison >> 9u];
    let number = (comparison >> 2u) & 127u;
    let here = box_of_own(number);
    let list = list_for(number);
    let is_edge = list == about.leaf_edges;
    let k = number - select(0u, own.vertices.count + own.triangles.count, is_edge);
    let others = features_of(list, other_leaf);
    let turn = ITEMS * (comparison & 3u);
    let end = others.first + min(turn + ITEMS, others.count);
    var begin = others.first + turn;
    if is_edge && other_leaf == leaf {
        begin = max(begin, own.edges.first + k + 1u);
    }
    var hits: u32;
    if list == about.leaf_vertices {
        hits = meeting_vertices(here, begin, end);
    } else {
        hits = meeting_boxes(here, begin, end, select(0u, about.box_edges, is_edge));
    }
    if hits == 0u {
        return;
    }
    var place = atomicAdd(&candidate_counts[u32(is_edge)], countOneBits(hits));
    for (; hits != 0u; hits &= hits - 1u) {
        let other = begin + firstTrailingBit(hits);
        candidates[select(place, CANDIDATES - 1u - place, is_edge)] = k * OTHERS + other;
        place++;
    }
}

// Compares own features with those of the leaves that were met. Returns false if there are too many pairs.
fn compare(leaf: u32, met_leaves: u32, lane: u32) -> bool {
    let features = own.vertices.count + own.triangles.count + own.edges.count;
    let all = met_leaves * features;
    for (var first = 0u; first < all; first += LANES) {
        let k = first + lane;
        if k < all {
            choose(k % features, leaf, k / features);
        }
        workgroupBarrier();
        var count = broadcast(atomicLoad(&chosen_count), lane);
        let least = select(LANES, 1u, first + LANES >= all);
        if count < least {
            continue;
        }
        while count >= least {
            let now = min(count, LANES);
            if lane < now {
                collect(chosen[count - now + lane], leaf);
            }
            count -= now;
            workgroupBarrier();
            if !list_candidates(LANES, lane) {
                return false;
            }
        }
        if lane == 0u {
            atomicStore(&chosen_count, count);
        }
        workgroupBarrier();
    }
    if lane == 0u {
        atomicStore(&met_count, 0u);
    }
    return true;
}

// Lists candidates of either kind while there are at least so many. Returns false if there are too many pairs.
fn list_candidates(least: u32, lane: u32) -> bool {
    let counts = broadcast((atomicLoad(&candidate_counts[1]) << 16u) | atomicLoad(&candidate_counts[0]), lane);
    if (counts & 0xffffu) < least && (counts >> 16u) < least {
        return true;
    }
    for (var kind = 0u; kind < 2u; kind++) {
        var count = select(counts & 0xffffu, counts >> 16u, kind == 1u);
        while count >= least {
            let now = min(count, LANES);
            let place = count - 1u - min(lane, now - 1u);
            let candidate = candidates[select(place, CANDIDATES - 1u - place, kind == 1u)];
            if !list_pair(kind, candidate, lane < now, lane) {
                return false;
            }
            count -= now;
        }
        if lane == 0u {
            atomicStore(&candidate_counts[kind], count);
        }
    }
    workgroupBarrier();
    return true;
}

// Lists the candidate of each invocation that has one, if it is close enough. Returns false if there are too many pairs.
fn list_pair(kind: u32, candidate: u32, is_one: bool, lane: u32) -> bool {
    let is_edge = kind == 1u;
    if lane == 0u {
        atomicStore(&listed_here, 0u);
    }
    workgroupBarrier();
    var pair = Listed();
    var rank = 0u;
    if is_one {
        pair = pair_of(is_edge, candidate / OTHERS, candidate % OTHERS);
        if pair.thickness > 0.0 {
            rank = atomicAdd(&listed_here, 1u);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        let more = atomicLoad(&listed_here);
        let listed = atomicAdd(&known.status.listed, more) + more;
        if is_edge {
            first_listed = atomicAdd(&known.status.with_edges, more);
        } else {
            first_listed = atomicAdd(&known.status.with_vertices, more);
        }
        if listed > about.room {
            atomicMax(&known.status.needed, listed);
            atomicOr(&known.status.stopped, select(NO_ROOM, CROWDED, listed > MOST_OF_ALL));
        }
    }
    let first = workgroupUniformLoad(&first_listed);
    let index = first + rank;
    if pair.thickness > 0.0 && index < about.room {
        pairs[known.status.half * about.room + select(index, about.room - 1u - index, is_edge)] = pair;
    }
    return first < MOST_OF_ALL;
}

// A candidate as a pair. Its thickness is 0 if it is not listed.
fn pair_of(is_edge: bool, k: u32, other: u32) -> Listed {
    var corners: vec4u;
    var row: u32;
    var second = other;
    if is_edge {
        // The edge with the lower index is the first.
        let one = own.edges.first + k;
        second = max(one, other);
        row = about.all_vertices + min(one, other);
        corners = vec4u(edge(min(one, other)), edge(second));
    } else {
        row = other;
        if k < own.vertices.count {
            row = own.vertices.first + k;
        } else {
            second = own.triangles.first + k - own.vertices.count;
        }
        row = vertex(row);
        corners = vec4u(row, triangle(second));
    }
    var pair = Listed();
    if are_adjacent(is_edge, corners) {
        return pair;
    }
    let thickness = thickness_of(is_edge, corners);
    if thickness > 0.0 && !is_let_go(is_edge, row, second) {
        pair = Listed(corners, held_before(row, second), second, thickness, row, 0u);
    }
    return pair;
}

@compute @workgroup_size(LANES)
fn detect(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    // Several workgroups share the own features of a leaf if there are many pairs.
    let part = group.x + group.y * groups.x;
    let leaf = part / about.sharing;
    // The number of pairs counts even if there is no room for them.
    let goes_on = known.status.detects != 0u && (atomicLoad(&known.status.stopped) & ~NO_ROOM) == 0u;
    if broadcast(u32(goes_on && leaf < leaves()), lane) == 0u {
        return;
    }
    if lane == 0u {
        own = Own(
            share_of(features_of(about.leaf_vertices, leaf), part),
            share_of(features_of(about.leaf_triangles, leaf), part),
            share_of(features_of(about.leaf_edges, leaf), part),
        );
        atomicStore(&candidate_counts[0], 0u);
        atomicStore(&candidate_counts[1], 0u);
        atomicStore(&chosen_count, 0u);
    }
    var reached = Reached(begin_descent(lane), 0u);
    while reached.held > 0u {
        reached = descend(leaf, reached.held, lane);
        if (reached.held == 0u || reached.met >= MET) && !compare(leaf, reached.met, lane) {
            return;
        }
    }
    list_candidates(1u, lane);
}
