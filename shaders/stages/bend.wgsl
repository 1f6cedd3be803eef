// Bending of a cloth that tiles do not hold: a dispatch for each exchange between neighbors. The first also predicts the
// displacements, which saves a dispatch.

@group(1) @binding(4) var<storage, read> rows: array<BendRow>;
// The slices of the rings of all vertices.
@group(1) @binding(5) var<storage, read> table: array<u32>;
// The intermediate vectors (see bend_ring.wgsl).
@group(1) @binding(6) var<storage, read_write> moments: array<vec4f>;
@group(1) @binding(7) var<uniform> bend_pass: BendPass;

fn ring_slices() -> u32 {
    return 0u;
}

fn is_filtered() -> bool {
    return bend_pass.gain != 0.0;
}

fn bend_pass_at(index: u32) -> BendPass {
    return bend_pass;
}

fn row_of(v: u32) -> BendRow {
    return rows[v];
}

fn bent_x(v: u32) -> vec3f {
    return x[v].xyz;
}

fn bent_p(v: u32) -> vec3f {
    return p[v].xyz;
}

fn bend_room() -> u32 {
    return params.vertices;
}

fn bend_vector(at: u32) -> vec3f {
    return moments[at].xyz;
}

fn set_bend_vector(at: u32, value: vec3f) {
    moments[at] = vec4f(value, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn bend_moments(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    predict_item(v);
    if v < params.vertices {
        first_moment(v, substep.rate, fetched(v));
    }
}

@compute @workgroup_size(WORKGROUP)
fn displace_tentatively(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    if v < params.vertices {
        trial_displacements(v, x[v].w, bend_pass);
    }
}

@compute @workgroup_size(WORKGROUP)
fn pass_moments(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    if v < params.vertices {
        filter_moments(v, bend_pass);
    }
}

@compute @workgroup_size(WORKGROUP)
fn bend_forces(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    if v < params.vertices && x[v].w != 0.0 {
        u[v] += vec4f(bend_force(v, fetched(v)) * (x[v].w * substep.gain), 0.0);
    }
}
