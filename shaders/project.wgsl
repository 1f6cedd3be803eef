// Stage 2: the edges of one colour, which share no vertex.

struct Edge {
    a: u32,
    b: u32,
    inverse_rest: f32,
    inverse_weight: f32,
}

struct Batch {
    first: u32,
    count: u32,
}

const TURN_GUARD: f32 = 0.9;
const STRETCH_GUARD: f32 = 0.1;

@group(1) @binding(0) var<uniform> batch: Batch;
@group(1) @binding(1) var<storage, read> edges: array<Edge>;
@group(1) @binding(2) var<storage, read> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> u: array<vec4f>;

// Along the edge's direction at the substep's start (SHAKE) while it has hardly turned or stretched; no square root.
fn project_edge(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    let inverse_square = edge.inverse_rest * edge.inverse_rest;
    let r = dot(d, d) * inverse_square - 1.0;
    let c = dot(d0, d) * inverse_square;
    let r0 = dot(d0, d0) * inverse_square - 1.0;
    if c > TURN_GUARD && abs(r) < STRETCH_GUARD && abs(r0) < STRETCH_GUARD {
        let unit = 1.0 - r0 * (0.5 - r0 * 0.375);
        return d0 * (-edge.inverse_weight * unit * r * (0.5 - r * (0.125 - r * 0.0625)));
    }
    return relax_edge(d0, du, edge);
}

// Along the edge's current direction.
fn relax_edge(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    let l = max(length(d), 1e-12);
    return d * (edge.inverse_weight * (1.0 / (edge.inverse_rest * l) - 1.0));
}

fn correct(k: u32, relaxation: bool) {
    if k >= batch.count {
        return;
    }
    let edge = edges[batch.first + k];
    let x_a = x[edge.a];
    let x_b = x[edge.b];
    let d0 = x_a.xyz - x_b.xyz;
    let du = u[edge.a].xyz - u[edge.b].xyz;
    var impulse: vec3f;
    if relaxation {
        impulse = relax_edge(d0, du, edge);
    } else {
        impulse = project_edge(d0, du, edge);
    }
    u[edge.a] += vec4f(impulse * x_a.w, 0.0);
    u[edge.b] -= vec4f(impulse * x_b.w, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn project(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    correct(item(id, groups), false);
}

@compute @workgroup_size(WORKGROUP)
fn relax(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    correct(item(id, groups), true);
}
