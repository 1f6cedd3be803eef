// An edge and the impulse that it gives its ends. The reasons are in src/kernels/distance.rs.

struct Edge {
    a: u32,
    b: u32,
    inverse_rest: f32,
    inverse_weight: f32,
}

const TURN_GUARD: f32 = 0.9;
const STRETCH_GUARD: f32 = 0.1;
// No edge is shorter [m] where its length divides.
const LEAST_LENGTH: f32 = 1e-12;

// The impulse of an edge: along its direction at the substep's start (SHAKE), without a square root, while it has hardly
// turned or stretched.
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

// The impulse of an edge along its current direction.
fn relax_edge(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    let l = max(length(d), LEAST_LENGTH);
    return d * (edge.inverse_weight * (1.0 / (edge.inverse_rest * l) - 1.0));
}

// The impulse of a coarse edge, which only pulls.
fn project_coarse(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    if dot(d, d) * edge.inverse_rest * edge.inverse_rest <= 1.0 {
        return vec3f();
    }
    return project_edge(d0, du, edge);
}
