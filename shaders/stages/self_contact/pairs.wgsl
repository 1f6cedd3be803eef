// The places of listed and near pairs.

// A number of pairs, and that of listed pairs of a vertex and a triangle, for all invocations of a workgroup. One of these
// loads them, because a device is slow when all load from one place.
var<workgroup> total: u32;
var<workgroup> with_vertices: u32;

// A half of the list is filled from both ends: by pairs of a vertex and a triangle from the start, and by pairs of edges
// from the end.
fn place(k: u32) -> u32 {
    let edges = k - with_vertices;
    return known.status.half * about.room + select(about.room - 1u - edges, k, k < with_vertices);
}

// The number of listed pairs, or 0 if the step has stopped, for all invocations.
fn listed_pairs(lane: u32) -> u32 {
    if lane == 0u {
        total = select(atomicLoad(&known.status.listed), 0u, has_stopped());
        with_vertices = atomicLoad(&known.status.with_vertices);
    }
    return workgroupUniformLoad(&total);
}

// The position of a near pair in `near`: those that act fill it from the start, the others from the end. Their order
// has no effect on the result.
fn place_of(state: u32, index: u32) -> u32 {
    return select(about.room - 1u - index, index, state == 2u);
}

fn is_idle() -> bool {
    return atomicLoad(&known.status.listed) == 0u || has_stopped();
}

fn stride(groups: vec3u) -> u32 {
    return groups.x * groups.y * WORKGROUP;
}
