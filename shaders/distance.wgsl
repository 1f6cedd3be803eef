// The distance constraint of an edge and its impulse. The derivations are in src/kernels/distance.rs.

struct Edge {
    a: u32,
    b: u32,
    inverse_rest: f32,
    inverse_weight: f32,
}

const TURN_GUARD: f32 = 0.9;
const STRETCH_GUARD: f32 = 0.1;
const FAR_TURN_GUARD: f32 = 0.5;
const SHORT_GUARD: f32 = 0.1;
const LONG_GUARD: f32 = 1.2;
const SLACK_BAND: f32 = 6.5e-4;
// Lower bound of lengths [m] that are used as divisors.
const LEAST_LENGTH: f32 = 1e-12;

// The impulse of an edge: along its direction at the substep's start (SHAKE) unless it has turned far, is very short or
// very long; without a square root while it has hardly turned or stretched.
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
    let stretch0 = edge.inverse_rest * length(d0);
    let stretch = edge.inverse_rest * length(d);
    let sound = stretch0 > SHORT_GUARD && stretch > SHORT_GUARD && stretch < LONG_GUARD;
    if sound && c > FAR_TURN_GUARD * stretch0 * stretch {
        return d0 * (-edge.inverse_weight * (stretch - 1.0) / stretch0);
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

// The impulse of a coarse edge that also pushes a little while it is hardly compressed.
fn hold_coarse(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    let r = dot(d, d) * edge.inverse_rest * edge.inverse_rest - 1.0;
    let left = max(1.0 + min(r, 0.0) / SLACK_BAND, 0.0);
    return project_edge(d0, du, edge) * (left * left);
}

fn coarse_impulse(d0: vec3f, du: vec3f, edge: Edge, holds: bool) -> vec3f {
    if holds {
        return hold_coarse(d0, du, edge);
    }
    return project_coarse(d0, du, edge);
}
