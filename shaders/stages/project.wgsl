// The edges of one color, which share no vertex. Sweeping with a dispatch per color is the simplest way and works for
// any mesh.

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read> edges: array<Edge>;
@group(1) @binding(2) var<storage, read> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> u: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn project(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k >= batch.count {
        return;
    }
    let edge = edges[batch.first + k];
    let x_a = x[edge.a];
    let x_b = x[edge.b];
    let impulse = edge_impulse(x_a.xyz - x_b.xyz, u[edge.a].xyz - u[edge.b].xyz, edge);
    u[edge.a] += vec4f(impulse * x_a.w, 0.0);
    u[edge.b] -= vec4f(impulse * x_b.w, 0.0);
}
