// The distance constraint of an edge and its impulse. The derivations are in src/kernels/distance.rs.

struct Edge {
    a: u32,
    b: u32,
    inverse_rest: f32,
    inverse_weight: f32,
}

const TURN_GUARD: f32 = 0.5;
const STRETCH_GUARD: f32 = 0.44;
const TAUT_BAND: f32 = 6.5e-4;
const LEAST_PART: f32 = 0.02;
// Lower bound of lengths [m] that are used as divisors.
const MIN_LENGTH: f32 = 1e-12;

// The impulse of an edge: along its direction at the substep's start (SHAKE) and without a square root, unless it has turned
// or stretched far.
fn project_edge(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    let inverse_square = edge.inverse_rest * edge.inverse_rest;
    let r = dot(d, d) * inverse_square - 1.0;
    let c = dot(d0, d) * inverse_square;
    let r0 = dot(d0, d0) * inverse_square - 1.0;
    if c > TURN_GUARD && abs(r) < STRETCH_GUARD && abs(r0) < STRETCH_GUARD {
        return d0 * (-edge.inverse_weight * inverse_length(r0) * excess_length(r));
    }
    return relax_edge(d0, du, edge);
}

// (l - l0)/l0, where r = (l/l0)^2 - 1.
fn excess_length(r: f32) -> f32 {
    return r * (0.5 + r * (-0.125 + r * (0.0625 + r * (-0.0429 + r * 0.0307))));
}

// l0/l, where r = (l/l0)^2 - 1.
fn inverse_length(r: f32) -> f32 {
    return 1.0 + r * (-0.5 + r * (0.375 + r * (-0.360 + r * 0.321)));
}

// The impulse of an edge along its current direction.
fn relax_edge(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    let l = max(length(d), MIN_LENGTH);
    return d * (edge.inverse_weight * (1.0 / (edge.inverse_rest * l) - 1.0));
}

// The impulse of an edge by the method of the step.
fn edge_impulse(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    if params.relaxed != 0u {
        return relax_edge(d0, du, edge);
    }
    return project_edge(d0, du, edge);
}

// The impulse of a coarse edge that only pulls.
fn pull_coarse(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    if dot(d, d) * edge.inverse_rest * edge.inverse_rest <= 1.0 {
        return vec3f();
    }
    return project_edge(d0, du, edge);
}

// The impulse of a coarse edge whose ends were predicted to move apart by `predicted`: it pulls, and undoes what other
// corrections shorten it by while it is hardly slack. `w` is the sum of the inverse masses of its ends. Pulls and pushes share
// a path, because a subgroup takes as long as all paths that any of its edges takes.
fn project_coarse(d0: vec3f, du: vec3f, predicted: vec3f, w: f32, edge: Edge) -> vec3f {
    let d = d0 + du;
    let p = d0 + predicted;
    let inverse_square = edge.inverse_rest * edge.inverse_rest;
    let r = dot(d, d) * inverse_square - 1.0;
    let c = dot(d0, d) * inverse_square;
    let r0 = dot(d0, d0) * inverse_square - 1.0;
    let is_slack = r < 0.0;
    if c > TURN_GUARD && abs(r) < STRETCH_GUARD && abs(r0) < STRETCH_GUARD {
        let before = select(0.0, min(dot(p, p) * inverse_square - 1.0, 0.0), is_slack);
        let left = max(1.0 + before * params.per_slack, 0.0);
        let part = select(1.0, max(edge.inverse_weight * w, LEAST_PART), is_slack);
        let excess = select(excess_length(r) - excess_length(before), 0.0, is_slack && r >= before);
        return d0 * (-edge.inverse_weight * left / part * inverse_length(r0) * excess);
    }
    if is_slack {
        return vec3f();
    }
    return relax_edge(d0, du, edge) / max(edge.inverse_weight * w, 1.0);
}

// The impulse of a coarse edge that also pushes a little while it is hardly compressed.
fn hold_coarse(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    let d = d0 + du;
    let r = dot(d, d) * edge.inverse_rest * edge.inverse_rest - 1.0;
    let left = 1.0 + min(r, 0.0) * (1.0 / TAUT_BAND);
    if left <= 0.0 {
        return vec3f();
    }
    return project_edge(d0, du, edge) * (left * left);
}

const PULL_COARSE: u32 = 0u;
const HOLD_COARSE: u32 = 1u;
const PROJECT_COARSE: u32 = 2u;

// The rule of most cloths is the first one, because a comparison takes a GPU as long as a twentieth of a coarse edge.
fn coarse_impulse(d0: vec3f, du: vec3f, predicted: vec3f, w: f32, edge: Edge) -> vec3f {
    if params.coarse_rule == PROJECT_COARSE {
        return project_coarse(d0, du, predicted, w, edge);
    }
    if params.coarse_rule == HOLD_COARSE {
        return hold_coarse(d0, du, edge);
    }
    return pull_coarse(d0, du, edge);
}
