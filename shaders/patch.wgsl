// A substep of a patch in workgroup memory. Beside its own vertices the workgroup holds all that they depend on through
// the colours of the sweep, and computes that too, without keeping it: so no workgroup waits for another, and the result
// is that of visiting the colours one after another.

@group(1) @binding(1) var<storage, read> x: array<vec4f>;
// The last displacements, or, if forces have predicted them, this substep's.
@group(1) @binding(2) var<storage, read> motion: array<vec4f>;
@group(1) @binding(3) var<storage, read> bodies: array<Body>;
@group(1) @binding(4) var<storage, read_write> x_out: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> p_out: array<vec4f>;
// What each aggregate of the finest coarse level is corrected by.
@group(1) @binding(6) var<storage, read> shift: array<vec4f>;

var<workgroup> at: array<vec4f, ROOM>;
var<workgroup> by: array<vec4f, ROOM>;

fn correct(edge: Edge) {
    let x_a = at[edge.a];
    let x_b = at[edge.b];
    let u_a = by[edge.a];
    let u_b = by[edge.b];
    let impulse = project_edge(x_a.xyz - x_b.xyz, u_a.xyz - u_b.xyz, edge);
    by[edge.a] = u_a + vec4f(impulse * x_a.w, 0.0);
    by[edge.b] = u_b - vec4f(impulse * x_b.w, 0.0);
}

fn before(color: u32, lane: u32) {}

fn meet() {
    workgroupBarrier();
}

@compute @workgroup_size(LANES)
fn substep_of_patch(
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
        let x_v = x[v];
        let motion_v = motion[v].xyz;
        var corrected = vec3f();
        if params.levels != 0u {
            corrected = shift[label_at(index, k)].xyz;
        }
        at[k] = x_v;
        by[k] = vec4f(motion_displacement(motion_v, x_v.w, substep) + corrected, 0.0);
    }
    workgroupBarrier();
    sweep(edges, first, lane);
    for (var k = lane; k < own; k += LANES) {
        let v = vertex_at(index, k);
        let w = at[k].w;
        var path = Path(at[k].xyz, by[k].xyz);
        if w > 0.0 {
            for (var body = 0u; body < params.bodies; body++) {
                path = contact_body(path.x, path.u, bodies[body], substep);
            }
        }
        x_out[v] = vec4f(path.x + path.u, w);
        p_out[v] = vec4f(path.u, params.h);
    }
}
