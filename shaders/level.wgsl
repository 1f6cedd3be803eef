// Coarse levels that are too large for one workgroup: a sweep of a patch of aggregates, as patch.wgsl does one of vertices.

@group(1) @binding(1) var<storage, read> centers: array<vec4f>;
@group(1) @binding(2) var<storage, read> predicted: array<vec4f>;
// What each aggregate is corrected by.
@group(1) @binding(3) var<storage, read_write> shift: array<vec4f>;

var<workgroup> at: array<vec4f, ROOM>;
var<workgroup> by: array<vec4f, ROOM>;

fn correct(edge: Edge) {
    let x_a = at[edge.a];
    let x_b = at[edge.b];
    let u_a = by[edge.a];
    let u_b = by[edge.b];
    let impulse = project_coarse(x_a.xyz - x_b.xyz, u_a.xyz - u_b.xyz, edge);
    by[edge.a] = u_a + vec4f(impulse * x_a.w, 0.0);
    by[edge.b] = u_b - vec4f(impulse * x_b.w, 0.0);
}

fn before(color: u32, lane: u32) {}

fn meet() {
    workgroupBarrier();
}

@compute @workgroup_size(LANES)
fn sweep_of_level(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let index = group.x + group.y * groups.x;
    if index >= PATCHES {
        return;
    }
    let edges = edges_of(index);
    let first = fetch_four(edges, 0u, lane);
    let own = own_vertices(index);
    for (var k = lane; k < ROOM; k += LANES) {
        let v = vertex_at(index, k);
        let above = label_at(index, k);
        at[k] = centers[v];
        by[k] = predicted[v];
        if above != NO_LABEL {
            by[k] += shift[above];
        }
    }
    workgroupBarrier();
    sweep(edges, first, lane);
    for (var k = lane; k < own; k += LANES) {
        let v = vertex_at(index, k);
        shift[v] = by[k] - predicted[v];
    }
}
