// The places of listed and near pairs, and the displacements of their corners.

// A number of pairs, for all invocations of a workgroup.
var<workgroup> total: u32;

fn place(k: u32) -> u32 {
    return known.status.half * about.room + k;
}

// The position of a near pair in `near`: those that act fill it from the start, the others from the end. Their order
// has no effect on the result.
fn place_of(state: u32, index: u32) -> u32 {
    return select(about.room - 1u - index, index, state == 2u);
}

fn is_idle() -> bool {
    return known.status.listed == 0u || has_stopped();
}

fn stride(groups: vec3u) -> u32 {
    return groups.x * groups.y * WORKGROUP;
}

fn displacements(corners: vec4u) -> Four {
    return Four(vertices[corners.x].u.xyz, vertices[corners.y].u.xyz, vertices[corners.z].u.xyz, vertices[corners.w].u.xyz);
}
