// Restriction to a coarse level: each aggregate gets the mass-weighted averages of its members. See
// src/multigrid/hierarchy.rs.

struct Member {
    item: u32,
    share: f32,
}

// Whether the members are vertices, whose displacements are yet to be predicted, or aggregates of the next finer level.
override OF_VERTICES: bool = true;
// Number of invocations that share the members of an aggregate.
override EACH: u32 = 16u;

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read> x: array<vec4f>;
@group(1) @binding(2) var<storage, read> motion: array<vec4f>;
@group(1) @binding(3) var<storage, read> spans: array<Span>;
@group(1) @binding(4) var<storage, read> members: array<Member>;
// Of the aggregates of all levels, finest first.
@group(1) @binding(5) var<storage, read_write> averages: array<Average>;

// Each invocation's partial sums.
var<workgroup> dx_of: array<vec3f, WORKGROUP>;
var<workgroup> u_of: array<vec3f, WORKGROUP>;

fn position_of(k: u32) -> vec4f {
    if OF_VERTICES {
        return x[k];
    }
    return averages[k].x;
}

// The predicted displacement in this substep. That of a vertex is in `motion` if a prediction stage ran; otherwise it is
// computed from the last displacement, which is there then.
fn displacement_of(k: u32, w: f32) -> vec3f {
    if !OF_VERTICES {
        return averages[k].u.xyz;
    }
    if params.predicted != 0u {
        return motion[k].xyz;
    }
    return select(predict_displacement(motion[k].xyz, substep), vec3f(), w == 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn restrict_level(me: Invocation, group: Workgroup) {
    let k = item(me.id, group.all);
    let aggregate = batch.first + min(k / EACH, batch.count - 1u);
    let span = spans[aggregate];
    let first = position_of(members[span.start].item).xyz;
    var dx = vec3f();
    var u = vec3f();
    for (var m = span.start + k % EACH; m < span.end; m += EACH) {
        let member = members[m];
        let at = position_of(member.item);
        dx += (at.xyz - first) * member.share;
        u += displacement_of(member.item, at.w) * member.share;
    }
    dx_of[me.lane] = dx;
    u_of[me.lane] = u;
    workgroupBarrier();
    if k % EACH != 0u || k / EACH >= batch.count {
        return;
    }
    for (var m = 1u; m < EACH; m++) {
        dx += dx_of[me.lane + m];
        u += u_of[me.lane + m];
    }
    averages[aggregate] = Average(vec4f(first + dx, averages[aggregate].x.w), vec4f(u, 0.0));
}
