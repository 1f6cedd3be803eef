// Bending, a force: first each vertex's mean curvature normal times its rigidity, then what its neighbours' ones do to it.

struct BendRow {
    stiffness: f32,
    tau: f32,
    diagonal: f32,
}

struct BendEntry {
    other: u32,
    forward: f32,
    backward: f32,
}

@group(1) @binding(0) var<storage, read> rows: array<BendRow>;
@group(1) @binding(1) var<storage, read> spans: array<Span>;
@group(1) @binding(2) var<storage, read> entries: array<BendEntry>;
@group(1) @binding(3) var<storage, read> x: array<vec4f>;
@group(1) @binding(4) var<storage, read> p: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> moments_out: array<vec4f>;
@group(1) @binding(6) var<storage, read> moments: array<vec4f>;
@group(1) @binding(7) var<storage, read_write> u: array<vec4f>;

// One term of y_v = sum_j c_vj ((x_j - x_v) + tau (v_j - v_v)).
fn bend_term(dx: vec3f, dv: vec3f, tau: f32, coefficient: f32) -> vec3f {
    return (dx + dv * tau) * coefficient;
}

@compute @workgroup_size(WORKGROUP)
fn bend_moments(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    if v >= params.vertices {
        return;
    }
    let row = rows[v];
    var y = vec3f();
    for (var k = spans[v].start; k < spans[v].end; k++) {
        let entry = entries[k];
        let dv = (p[entry.other].xyz - p[v].xyz) * substep.rate;
        y += bend_term(x[entry.other].xyz - x[v].xyz, dv, row.tau, entry.forward);
    }
    moments_out[v] = vec4f(y * row.stiffness, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn bend_forces(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices {
        return;
    }
    var force = -moments[i].xyz * rows[i].diagonal;
    for (var k = spans[i].start; k < spans[i].end; k++) {
        force -= moments[entries[k].other].xyz * entries[k].backward;
    }
    u[i] += vec4f(force * (x[i].w * substep.gain), 0.0);
}
