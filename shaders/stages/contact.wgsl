// The end of a substep as a dispatch of its own: tethers, collisions and the move. p.w stores the substep's length that
// p was computed with, so that a restored state includes it.

@group(1) @binding(0) var<storage, read> x: array<vec4f>;
@group(1) @binding(1) var<storage, read> u: array<vec4f>;
@group(1) @binding(2) var<storage, read> bodies: array<Body>;
@group(1) @binding(3) var<storage, read_write> x_out: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> p_out: array<vec4f>;
@group(1) @binding(5) var<storage, read> tethers: array<Tether>;

fn tether_of(v: u32) -> Tether {
    return tethers[v];
}

@compute @workgroup_size(WORKGROUP)
fn contact(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices {
        return;
    }
    let x_i = x[i];
    let path = after_contact(i, x_i, u[i].xyz, substep);
    x_out[i] = vec4f(path.x + path.u, x_i.w);
    p_out[i] = vec4f(path.u, params.h);
}
