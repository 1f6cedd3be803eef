// Forces of explicit springs: each vertex sums the forces of its springs.

@group(1) @binding(0) var<storage, read> springs_at: array<Spring>;
@group(1) @binding(1) var<storage, read> spans: array<Span>;
@group(1) @binding(2) var<storage, read> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> u: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn springs(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices || x[i].w == 0.0 {
        return;
    }
    var force = vec3f();
    for (var k = spans[i].start; k < spans[i].end; k++) {
        force += spring_force(x[springs_at[k].other].xyz - x[i].xyz, springs_at[k]);
    }
    u[i] += vec4f(force * (x[i].w * substep.gain), 0.0);
}
