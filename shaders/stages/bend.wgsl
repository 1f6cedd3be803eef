// Bending forces: first the moment of each vertex's row (its mean curvature normal times its rigidity), then the forces
// of the moments around each vertex. The first stage also predicts the displacements, which saves a dispatch. Where
// bending takes several passes of a filter, in between the vertices are displaced tentatively under the moments so far,
// and the rows recompute their moments.

@group(1) @binding(4) var<storage, read> rows: array<BendRow>;
@group(1) @binding(5) var<storage, read> spans: array<Span>;
@group(1) @binding(6) var<storage, read> entries: array<BendEntry>;
// For each vertex its moment and its couple. With several passes followed by, for all vertices: the curvature
// normals, the changes of the moments in the last pass, the tentative displacements, and the damping parts of the
// moments.
@group(1) @binding(7) var<storage, read_write> moments: array<vec4f>;
@group(1) @binding(8) var<uniform> bend_pass: BendPass;

fn moment_of(v: u32) -> u32 {
    return 2u * v;
}

fn couple_at(v: u32) -> u32 {
    return 2u * v + 1u;
}

fn curvature_of(v: u32) -> u32 {
    return 2u * params.vertices + v;
}

fn change_of(v: u32) -> u32 {
    return 3u * params.vertices + v;
}

fn trial_of(v: u32) -> u32 {
    return 4u * params.vertices + v;
}

fn resisted_of(v: u32) -> u32 {
    return 5u * params.vertices + v;
}

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
    let stiffness = rows[v].stiffness;
    let damping = stiffness * rows[v].tau;
    if bend_pass.gain == 0.0 {
        let bend = bend_moment(ring, stiffness, damping);
        moments[moment_of(v)] = vec4f(bend.moment, 0.0);
        moments[couple_at(v)] = vec4f(bend.couple, 0.0);
        return;
    }
    let resisted = bend_moment(ring, 0.0, damping);
    let passed = next_moment(vec3f(), vec3f(), ring.y, stiffness, bend_pass);
    moments[moment_of(v)] = vec4f(passed.moment, 0.0);
    moments[couple_at(v)] = vec4f(resisted.couple, 0.0);
    moments[curvature_of(v)] = vec4f(ring.y, 0.0);
    moments[change_of(v)] = vec4f(passed.change, 0.0);
    moments[resisted_of(v)] = vec4f(resisted.moment, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn trial_displacements(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices {
        return;
    }
    var force = moments[moment_of(i)].xyz * rows[i].diagonal;
    for (var k = spans[i].start; k < spans[i].end; k++) {
        let entry = entries[k];
        force += moments[moment_of(entry.other)].xyz * entry.backward;
    }
    moments[trial_of(i)] = vec4f(force * (x[i].w * bend_pass.trial), 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn filter_moments(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let v = item(id, groups);
    if v >= params.vertices {
        return;
    }
    let own = moments[trial_of(v)].xyz;
    var bent = moments[curvature_of(v)].xyz;
    for (var k = spans[v].start; k < spans[v].end; k++) {
        let entry = entries[k];
        bent += (moments[trial_of(entry.other)].xyz - own) * entry.forward;
    }
    let passed = next_moment(moments[moment_of(v)].xyz, moments[change_of(v)].xyz, bent, rows[v].stiffness, bend_pass);
    if bend_pass.last == 0u {
        moments[moment_of(v)] = vec4f(passed.moment, 0.0);
        moments[change_of(v)] = vec4f(passed.change, 0.0);
    } else {
        moments[moment_of(v)] = vec4f(passed.moment, 0.0) + moments[resisted_of(v)];
    }
}

@compute @workgroup_size(WORKGROUP)
fn bend_forces(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices || x[i].w == 0.0 {
        return;
    }
    let own = moments[couple_at(i)].xyz;
    var force = -moments[moment_of(i)].xyz * rows[i].diagonal;
    for (var k = spans[i].start; k < spans[i].end; k++) {
        let entry = entries[k];
        force -= moments[moment_of(entry.other)].xyz * entry.backward;
        if params.damped != 0u {
            let d = x[entry.other].xyz - x[i].xyz;
            force -= cross(couple_of(own, moments[couple_at(entry.other)].xyz, entry), d);
        }
    }
    u[i] += vec4f(force * (x[i].w * substep.gain), 0.0);
}
