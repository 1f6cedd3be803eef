// Once a step: if the state that its last substep made is within bounds it becomes the cloth's, else the cloth stays as it
// was. Nothing is read back for it.

@group(1) @binding(0) var<storage, read> x_made: array<vec4f>;
@group(1) @binding(1) var<storage, read> p_made: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> p: array<vec4f>;
// The first vertex that is not; all ones if none.
@group(1) @binding(4) var<storage, read_write> first_bad: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn check(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i < params.vertices && !(is_bounded(x_made[i].xyz) && is_bounded(p_made[i].xyz)) {
        atomicMin(&first_bad, i);
    }
}

@compute @workgroup_size(WORKGROUP)
fn commit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i < params.vertices && atomicLoad(&first_bad) == NONE {
        x[i] = x_made[i];
        p[i] = p_made[i];
    }
}
