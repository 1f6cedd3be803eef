// Coarse levels in the simplest way, for any mesh: a dispatch prolongates the correction of the next coarser level, and
// then each color is a dispatch.

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read> edges: array<Edge>;
@group(1) @binding(2) var<storage, read> averages: array<Average>;
@group(1) @binding(3) var<storage, read> labels: array<u32>;
// Corrected displacements of the aggregates of all levels.
@group(1) @binding(4) var<storage, read_write> corrected: array<vec4f>;
// Corrections of the finest level.
@group(1) @binding(5) var<storage, read_write> shift: array<vec4f>;
@group(1) @binding(6) var<storage, read_write> u: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn begin_at(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k < batch.count {
        corrected[batch.first + k] = averages[batch.first + k].u;
    }
}

@compute @workgroup_size(WORKGROUP)
fn prolongate(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k >= batch.count {
        return;
    }
    let aggregate = batch.first + k;
    let above = labels[aggregate];
    corrected[aggregate] = averages[aggregate].u + (corrected[above] - averages[above].u);
}

@compute @workgroup_size(WORKGROUP)
fn sweep_coarse(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k >= batch.count {
        return;
    }
    let edge = edges[batch.first + k];
    let a = averages[edge.a];
    let b = averages[edge.b];
    let du = corrected[edge.a].xyz - corrected[edge.b].xyz;
    let impulse = coarse_impulse(a.x.xyz - b.x.xyz, du, a.u.xyz - b.u.xyz, a.x.w + b.x.w, edge);
    corrected[edge.a] += vec4f(impulse * a.x.w, 0.0);
    corrected[edge.b] -= vec4f(impulse * b.x.w, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn note_shift(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k < batch.count {
        shift[k] = corrected[k] - averages[k].u;
    }
}

@compute @workgroup_size(WORKGROUP)
fn correct_vertices(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i < params.vertices {
        u[i] += shift[labels[i]];
    }
}
