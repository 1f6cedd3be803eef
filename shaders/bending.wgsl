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

// Stiffness times y + tau dy/dt, of the rate the part along y alone: it damps a change of curvature, not a rotation.
fn bend_moment(y: vec3f, rate: vec3f, row: BendRow) -> vec3f {
    let growth = dot(y, rate) / max(dot(y, y), 1e-30);
    return y * (row.stiffness * (1.0 + row.tau * growth));
}

@compute @workgroup_size(WORKGROUP)
fn bend_moments(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    if v >= params.vertices {
        return;
    }
    var y = vec3f();
    var rate = vec3f();
    for (var k = spans[v].start; k < spans[v].end; k++) {
        let entry = entries[k];
        y += (x[entry.other].xyz - x[v].xyz) * entry.forward;
        rate += (p[entry.other].xyz - p[v].xyz) * entry.forward;
    }
    moments_out[v] = vec4f(bend_moment(y, rate * substep.rate, rows[v]), 0.0);
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
