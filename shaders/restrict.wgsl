// Coarse levels, first: each aggregate takes the mass-weighted average of what it is made of. See src/levels.rs.

struct Member {
    item: u32,
    share: f32,
}

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read> x: array<vec4f>;
@group(1) @binding(2) var<storage, read> motion: array<vec4f>;
@group(1) @binding(3) var<storage, read> spans: array<Span>;
@group(1) @binding(4) var<storage, read> members: array<Member>;
// Of all levels, the finest first: centres and inverse masses, and displacements as predicted.
@group(1) @binding(5) var<storage, read_write> centers: array<vec4f>;
@group(1) @binding(6) var<storage, read_write> predicted: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn restrict_vertices(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k >= batch.count {
        return;
    }
    let aggregate = batch.first + k;
    let span = spans[aggregate];
    let first = x[members[span.start].item].xyz;
    var dx = vec3f();
    var by = vec3f();
    for (var m = span.start; m < span.end; m++) {
        let member = members[m];
        let x_v = x[member.item];
        dx += (x_v.xyz - first) * member.share;
        by += motion_displacement(motion[member.item].xyz, x_v.w, substep) * member.share;
    }
    centers[aggregate] = vec4f(first + dx, centers[aggregate].w);
    predicted[aggregate] = vec4f(by, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn restrict_aggregates(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k >= batch.count {
        return;
    }
    let aggregate = batch.first + k;
    let span = spans[aggregate];
    let first = centers[members[span.start].item].xyz;
    var dx = vec3f();
    var by = vec3f();
    for (var m = span.start; m < span.end; m++) {
        let member = members[m];
        dx += (centers[member.item].xyz - first) * member.share;
        by += predicted[member.item].xyz * member.share;
    }
    centers[aggregate] = vec4f(first + dx, centers[aggregate].w);
    predicted[aggregate] = vec4f(by, 0.0);
}
