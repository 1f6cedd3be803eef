// The minimal operations of a step, to measure what a device can achieve at best.

@group(0) @binding(0) var<storage, read> numbers: array<u32>;
@group(0) @binding(1) var<storage, read_write> from_or_out: array<vec4f>;

@group(0) @binding(0) var<storage, read_write> source: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4f>;

// The output of a dispatch, which is the input of the next one in a chain.
@group(0) @binding(2) var<storage, read_write> to: array<vec4f>;

@compute @workgroup_size(64)
fn chain(@builtin(local_invocation_index) lane: u32) {
    to[lane] = from_or_out[numbers[lane] + lane] + vec4f(1.0);
}

@compute @workgroup_size(256)
fn copy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let lanes = 256u * groups.x;
    copied[id.x] = source[id.x];
    copied[id.x + lanes] = source[id.x + lanes];
    copied[id.x + 2u * lanes] = source[id.x + 2u * lanes];
    copied[id.x + 3u * lanes] = source[id.x + 3u * lanes];
}

// Positions and displacements of a tile. In each color, an invocation corrects an edge between vertices that the last
// color has moved.
var<workgroup> at: array<vec4f, 512>;
var<workgroup> by: array<vec4f, 512>;

@compute @workgroup_size(256)
fn colors(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) group: vec3u) {
    for (var k = lane; k < 512u; k += 256u) {
        at[k] = vec4f(f32(k), 0.0, 0.0, 1.0);
        by[k] = vec4f(0.0, 1e-3 * f32(k % 7u), 0.0, 0.0);
    }
    workgroupBarrier();
    let count = numbers[0];
    for (var color = 0u; color < count; color++) {
        // Alternately along rows and from row to row.
        let a = select(lane, 2u * lane, color % 2u == 0u);
        let b = select(lane + 256u, 2u * lane + 1u, color % 2u == 0u);
        let x_a = at[a];
        let x_b = at[b];
        let u_a = by[a];
        let u_b = by[b];
        let rest = select(256.0, 1.0, color % 2u == 0u);
        let edge = Edge(a, b, 1.0 / rest, 0.5);
        let impulse = project_edge(x_a.xyz - x_b.xyz, u_a.xyz - u_b.xyz, edge);
        by[a] = u_a + vec4f(impulse * x_a.w, 0.0);
        by[b] = u_b - vec4f(impulse * x_b.w, 0.0);
        workgroupBarrier();
    }
    if lane == 0u {
        from_or_out[group.x] = by[1] + by[300];
    }
}
