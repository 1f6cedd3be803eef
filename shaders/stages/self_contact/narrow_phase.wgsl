// Bounds all features; and the narrow phase, which lists the candidates that are close enough, with the previous multipliers of
// those that were listed before.

const MEASURERS: u32 = 128u;

// Numbers of pairs of either kind that a workgroup lists, and where they begin.
var<workgroup> listed_here: array<atomic<u32>, 2>;
var<workgroup> first_listed: array<u32, 2>;
var<workgroup> with_triangles: u32;

// Whether a pair is in the list of those of its kind.
fn is_ignored(is_edge: bool, row: u32, other: u32) -> bool {
    if is_edge {
        return is_among(vec2u(row - contact_params.all_vertices, other), contact_params.ignored, contact_params.ignored_edges);
    }
    return is_among(vec2u(row, other), 0u, contact_params.ignored);
}

// The least distance at which a pair is held, as a share of the thickness.
const LEAST_HELD: f32 = 0.002;

// The distance at which a pair is held, or 0 if it cannot come so close within the substeps that detection covers.
fn distance_to_hold(is_edge: bool, corners: vec4u) -> f32 {
    let a = place_at(corners.x);
    let b = place_at(corners.y);
    let c = place_at(corners.z);
    let d = place_at(corners.w);
    let y = Four(a.middle.xyz, b.middle.xyz, c.middle.xyz, d.middle.xyz);
    let apart = length(between(closest(is_edge, y), y));
    var relative = max(square(a.u - c.u), square(a.u - d.u));
    if is_edge {
        relative = max(relative, max(square(b.u - c.u), square(b.u - d.u)));
    } else {
        relative = max(relative, square(a.u - b.u));
    }
    let margin = sum_of_sides(is_edge, vec4f(a.middle.w, b.middle.w, c.middle.w, d.middle.w));
    // A lower bound on the distance.
    let left = apart - margin - sqrt(relative) * (0.5 * contact_state.status.ahead);
    if !(left < contact_params.thickness) {
        return 0.0;
    }
    var thickness = contact_params.thickness;
    if piece_of(corners.x) == piece_of(corners.w) {
        let rest = Four(rest_of(corners.x), rest_of(corners.y), rest_of(corners.z), rest_of(corners.w));
        thickness = min(thickness, max(0.5 * length(between(closest(is_edge, rest), rest)), LEAST_HELD * thickness));
    }
    return select(0.0, thickness, left < reach(is_edge, thickness, corners));
}

// The position of a pair of the previous list.
fn previous_place(k: u32) -> u32 {
    let with_vertices = contact_state.status.vertices_before;
    let edges = k - with_vertices;
    let first = (1u - contact_state.status.half) * contact_params.room;
    return first + select(contact_params.room - 1u - edges, k, k < with_vertices);
}

// The bucket that a pair of the previous list is in. There is a power of two of them.
fn bucket_of(row: u32, other: u32) -> u32 {
    let mixed = (row * 0x9e3779b1u) ^ (other * 0x85ebca6bu);
    return (mixed ^ (mixed >> 15u)) & (arrayLength(&buckets) - 1u);
}

// The multipliers of a pair in the previous list.
fn previous_lambda(row: u32, other: u32) -> vec4f {
    var next = atomicLoad(&buckets[bucket_of(row, other)]);
    while next != 0u {
        let at = previous_place(next - 1u);
        if pairs[at].row == row && pairs[at].other == other {
            return pairs[at].lambda;
        }
        next = pairs[at].next;
    }
    return vec4f();
}

// Puts a pair of the previous list into a bucket if it has multipliers: an element of `buckets` is 1 more than the number of a
// pair, whose `next` is 1 more than that of another, or 0 at the end.
fn insert(k: u32) {
    let at = previous_place(k);
    if any(pairs[at].lambda != vec4f()) {
        pairs[at].next = atomicExchange(&buckets[bucket_of(pairs[at].row, pairs[at].other)], k + 1u);
    }
}

// Computes the boxes of the triangles, edges and vertices, and the bounds of the normals of the cloth's triangles. Puts the
// previous list's pairs into buckets.
@compute @workgroup_size(WORKGROUP)
fn prepare(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    if !is_due() {
        return;
    }
    let first = item(id, groups);
    let stride = groups.x * groups.y * WORKGROUP;
    for (var k = first; k < arrayLength(&boxes); k += stride) {
        boxes[k] = packed(box_of_feature(k));
    }
    // Mesh colliders do not meet themselves.
    for (var k = first; k < arrayLength(&normals); k += stride) {
        let corners = triangle(k);
        normals[k] = normals_on_path(tracks[corners.x], tracks[corners.y], tracks[corners.z]);
    }
    // Only those that acted in the previous substep have multipliers. At the start of a step it is not known which did.
    if index_of_substep() > 0u {
        for (var k = first; k < contact_state.status.acted; k += stride) {
            insert(listed_at(k));
        }
        return;
    }
    for (var k = first; k < contact_state.status.vertices_before + contact_state.status.edges_before; k += stride) {
        insert(k);
    }
}

fn are_adjacent(is_edge: bool, c: vec4u) -> bool {
    return c.x == c.z || c.x == c.w || select(c.x == c.y, c.y == c.z || c.y == c.w, is_edge);
}

fn corners_of(is_edge: bool, row: u32, other: u32) -> vec4u {
    if is_edge {
        return vec4u(edge(row - contact_params.all_vertices), edge(other));
    }
    return vec4u(row, triangle(other));
}

// The thickness of a candidate as a pair, or 0 if it is not listed.
fn thickness_of(is_edge: bool, row: u32, other: u32) -> f32 {
    let corners = corners_of(is_edge, row, other);
    if are_adjacent(is_edge, corners) {
        return 0.0;
    }
    let thickness = distance_to_hold(is_edge, corners);
    return select(0.0, thickness, thickness > 0.0 && !is_ignored(is_edge, row, other));
}

@compute @workgroup_size(MEASURERS)
fn measure(me: Invocation, group: Workgroup) {
    if me.lane == 0u {
        with_triangles = atomicLoad(&contact_state.status.candidates);
        let all = with_triangles + atomicLoad(&contact_state.status.edge_candidates);
        total = select(0u, all, goes_on() && all <= CANDIDATES * space());
        if goes_on() && number_of(group) == 0u {
            demand_space(all, CANDIDATES);
        }
    }
    let end = workgroupUniformLoad(&total);
    for (var first = number_of(group) * MEASURERS; first < end; first += group.all.x * group.all.y * MEASURERS) {
        if me.lane < 2u {
            atomicStore(&listed_here[me.lane], 0u);
        }
        workgroupBarrier();
        let k = first + me.lane;
        let is_edge = k >= with_triangles;
        var candidate: vec2u;
        var thickness = 0.0;
        var rank = 0u;
        if k < end {
            candidate = scratch[place_of_candidate(select(k, k - with_triangles, is_edge), is_edge)];
            thickness = thickness_of(is_edge, candidate.x, candidate.y);
            if thickness > 0.0 {
                rank = atomicAdd(&listed_here[u32(is_edge)], 1u);
            }
        }
        workgroupBarrier();
        reserve(me.lane);
        workgroupBarrier();
        // Only now is the rest of a pair computed, which would take registers while places are waited for.
        let index = first_listed[u32(is_edge)] + rank;
        if thickness > 0.0 && index < contact_params.room {
            let corners = corners_of(is_edge, candidate.x, candidate.y);
            let held = previous_lambda(candidate.x, candidate.y);
            pairs[contact_state.status.half * contact_params.room + select(index, contact_params.room - 1u - index, is_edge)] =
                Listed(corners, held, candidate.y, thickness, candidate.x, 0u);
        }
    }
}

// Reserves places in the list for the pairs of a workgroup, most of which have pairs of one kind only. Three invocations do so,
// because each must wait for an answer.
fn reserve(lane: u32) {
    if lane < 2u {
        let more = atomicLoad(&listed_here[lane]);
        if more > 0u && lane == 0u {
            first_listed[0] = atomicAdd(&contact_state.status.with_vertices, more);
        } else if more > 0u {
            first_listed[1] = atomicAdd(&contact_state.status.with_edges, more);
        }
    } else if lane == 2u {
        let more = atomicLoad(&listed_here[0]) + atomicLoad(&listed_here[1]);
        if more == 0u {
            return;
        }
        let listed = atomicAdd(&contact_state.status.listed, more) + more;
        if listed > contact_params.room {
            atomicMax(&contact_state.status.needed, listed);
            atomicOr(&contact_state.status.stopped, select(NO_ROOM, CROWDED, listed > MAX_PAIRS));
        }
    }
}
