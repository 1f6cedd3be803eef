// The range of the displacements of mesh colliders near the cloth, once in a step: `Bodies::find_near` in
// `src/contact/bodies.rs`.

// A vertex counts as near the cloth if it is within the cloth's bounding box, enlarged by this share of its largest extent.
const NEAR: f32 = 0.1;

// Bounds the cloth at the start of the step.
@compute @workgroup_size(WORKGROUP)
fn bound_cloth(me: Invocation, group: Workgroup) {
    let i = item(me.id, group.all);
    var part = nothing();
    if i < params.used {
        part = Part(x[i], x[i]);
    }
    store_part(part, 0u, contact_params.groups, me.lane, group);
}

// The displacement in a substep of a vertex of mesh colliders besides their rotation, if it is near the cloth.
fn part_of_mesh(motion: Track, cloth: Part) -> Part {
    let extent = cloth.high.xyz - cloth.low.xyz;
    let enlargement = abs(motion.by.xyz) + NEAR * max(max(extent.x, extent.y), extent.z);
    let end = motion.start.xyz + motion.by.xyz;
    let least = min(motion.start.xyz, end) - enlargement;
    let most = max(motion.start.xyz, end) + enlargement;
    if all(least <= cloth.high.xyz) && all(most >= cloth.low.xyz) {
        let u = vec4f(motion.by.xyz * params.fraction - by_turning(motion.start.xyz), 0.0);
        return Part(u, u);
    }
    return nothing();
}

@compute @workgroup_size(WORKGROUP)
fn bound_meshes(me: Invocation, group: Workgroup) {
    var part = nothing();
    for (var k = me.lane; k < contact_params.groups; k += WORKGROUP) {
        part = both(part, contact_state.parts[k]);
    }
    gather(part, me.lane);
    workgroupBarrier();
    let cloth = Part(low[0], high[0]);
    workgroupBarrier();
    let i = contact_params.mesh_first + item(me.id, group.all);
    part = nothing();
    if i < contact_params.all_vertices {
        part = part_of_mesh(tracks[contact_params.all_vertices + i - contact_params.mesh_first], cloth);
    }
    store_part(part, contact_params.groups, contact_params.mesh_groups, me.lane, group);
}
