// Bending, a force: first each vertex's mean curvature normal times its rigidity, then what its neighbors' ones do to it.
// The first also predicts: it saves a dispatch.

@group(1) @binding(4) var<storage, read> rows: array<BendRow>;
@group(1) @binding(5) var<storage, read> spans: array<Span>;
@group(1) @binding(6) var<storage, read> entries: array<BendEntry>;
@group(1) @binding(7) var<storage, read_write> moments: array<Moment>;

@compute @workgroup_size(WORKGROUP)
fn bend_moments(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    predict_item(v);
    if v >= params.vertices {
        return;
    }
    var ring = Ring();
    for (var k = spans[v].start; k < spans[v].end; k++) {
        let entry = entries[k];
        let d = x[entry.other].xyz - x[v].xyz;
        if params.damped == 0u {
            ring.y += d * entry.forward;
        } else if entry.forward != 0.0 {
            add_neighbor(&ring, d, (p[entry.other].xyz - p[v].xyz) * substep.rate, entry.forward);
        }
    }
    moments[v] = bend_moment(ring, rows[v]);
}

@compute @workgroup_size(WORKGROUP)
fn bend_forces(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices || x[i].w == 0.0 {
        return;
    }
    let own = moments[i];
    var force = -own.pull * rows[i].diagonal;
    for (var k = spans[i].start; k < spans[i].end; k++) {
        let entry = entries[k];
        force -= moments[entry.other].pull * entry.backward;
        if params.damped != 0u {
            let d = x[entry.other].xyz - x[i].xyz;
            force -= cross(couple_of(own.couple, moments[entry.other].couple, entry), d);
        }
    }
    u[i] += vec4f(force * (x[i].w * substep.gain), 0.0);
}
