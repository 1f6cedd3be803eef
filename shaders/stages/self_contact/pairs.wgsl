// The places of listed and near pairs.

// The number of listed pairs of a vertex and a triangle, for all invocations of a workgroup.
var<workgroup> with_vertices: u32;

// A half of the list is filled from both ends: by pairs of a vertex and a triangle from the start, and by pairs of edges
// from the end.
fn place(k: u32) -> u32 {
    let edges = k - with_vertices;
    return contact_state.status.half * contact_params.room + select(contact_params.room - 1u - edges, k, k < with_vertices);
}

// The number of listed pairs, or 0 if the step has stopped, for all invocations.
fn listed_pairs(lane: u32) -> u32 {
    if lane == 0u {
        total = select(atomicLoad(&contact_state.status.listed), 0u, has_stopped());
        with_vertices = atomicLoad(&contact_state.status.with_vertices);
    }
    return workgroupUniformLoad(&total);
}

// The position of a near pair in `near`: those that act fill it from the start, the others from the end. Their order
// has no effect on the result.
fn place_of(state: u32, index: u32) -> u32 {
    return select(contact_params.room - 1u - index, index, state == 2u);
}

fn is_idle() -> bool {
    return atomicLoad(&contact_state.status.listed) == 0u || has_stopped();
}

fn stride(groups: vec3u) -> u32 {
    return groups.x * groups.y * WORKGROUP;
}

// Near pairs are kept in five arrays of vectors, as bits, because neighboring invocations read them faster that way.
fn near_at(k: u32) -> Near {
    let normal = bitcast<vec4f>(near[2u * contact_params.room + k]);
    let lambda = bitcast<vec4f>(near[3u * contact_params.room + k]);
    let rest = near[4u * contact_params.room + k];
    let numbers = bitcast<vec4f>(rest);
    let weights = bitcast<vec4f>(near[contact_params.room + k]);
    return Near(near[k], weights, normal.xyz, normal.w, lambda, numbers.x, numbers.y, rest.z, numbers.w);
}

fn set_near(k: u32, n: Near) {
    near[k] = n.corners;
    near[contact_params.room + k] = bitcast<vec4u>(n.weights);
    near[2u * contact_params.room + k] = bitcast<vec4u>(vec4f(n.normal, n.distance));
    near[3u * contact_params.room + k] = bitcast<vec4u>(n.lambda);
    let numbers = bitcast<vec3u>(vec3f(n.thickness, n.rate, n.friction));
    near[4u * contact_params.room + k] = vec4u(numbers.xy, n.listed, numbers.z);
}

fn set_lambda(k: u32, lambda: vec4f) {
    near[3u * contact_params.room + k] = bitcast<vec4u>(lambda);
}

fn set_rate(k: u32, rate: f32) {
    near[4u * contact_params.room + k].y = bitcast<u32>(rate);
}

// The number of pairs that act, or 0 if the step has stopped, for all invocations.
fn acting_pairs(lane: u32) -> u32 {
    if lane == 0u {
        total = select(atomicLoad(&contact_state.status.acting), 0u, is_idle());
    }
    return workgroupUniformLoad(&total);
}

fn inverse_masses(corners: vec4u) -> vec4f {
    return vec4f(vertices[corners.x].u.w, vertices[corners.y].u.w, vertices[corners.z].u.w, vertices[corners.w].u.w);
}

// By how much [m] the sides of a near pair are farther from each other than they are held, given inverse masses; below 0 if they are
// too close.
fn room_of(n: Near, w: vec4f) -> f32 {
    return n.distance - held_distance(n.thickness, select(n.weights, vec4f(), w > vec4f()));
}
