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

fn member_at(m: u32, end: u32) -> Member {
    let member = members[min(m, end - 1u)];
    return Member(member.item, select(0.0, member.share, m < end));
}

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
    // Four at a time, so that none waits for the one before; past the last there is the last again, with no share.
    for (var m = span.start; m < span.end; m += 4u) {
        let a = member_at(m, span.end);
        let b = member_at(m + 1u, span.end);
        let c = member_at(m + 2u, span.end);
        let d = member_at(m + 3u, span.end);
        let x_a = x[a.item];
        let x_b = x[b.item];
        let x_c = x[c.item];
        let x_d = x[d.item];
        let u_a = motion[a.item].xyz;
        let u_b = motion[b.item].xyz;
        let u_c = motion[c.item].xyz;
        let u_d = motion[d.item].xyz;
        dx += (x_a.xyz - first) * a.share;
        dx += (x_b.xyz - first) * b.share;
        dx += (x_c.xyz - first) * c.share;
        dx += (x_d.xyz - first) * d.share;
        by += motion_displacement(u_a, x_a.w, substep) * a.share;
        by += motion_displacement(u_b, x_b.w, substep) * b.share;
        by += motion_displacement(u_c, x_c.w, substep) * c.share;
        by += motion_displacement(u_d, x_d.w, substep) * d.share;
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
    for (var m = span.start; m < span.end; m += 4u) {
        let a = member_at(m, span.end);
        let b = member_at(m + 1u, span.end);
        let c = member_at(m + 2u, span.end);
        let d = member_at(m + 3u, span.end);
        let x_a = centers[a.item].xyz;
        let x_b = centers[b.item].xyz;
        let x_c = centers[c.item].xyz;
        let x_d = centers[d.item].xyz;
        let u_a = predicted[a.item].xyz;
        let u_b = predicted[b.item].xyz;
        let u_c = predicted[c.item].xyz;
        let u_d = predicted[d.item].xyz;
        dx += (x_a - first) * a.share;
        dx += (x_b - first) * b.share;
        dx += (x_c - first) * c.share;
        dx += (x_d - first) * d.share;
        by += u_a * a.share;
        by += u_b * b.share;
        by += u_c * c.share;
        by += u_d * d.share;
    }
    centers[aggregate] = vec4f(first + dx, centers[aggregate].w);
    predicted[aggregate] = vec4f(by, 0.0);
}
