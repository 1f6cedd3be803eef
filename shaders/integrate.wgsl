// Prediction of a vertex's displacement without constraints. The derivations are in src/kernels/integrate.rs.

struct Pin {
    origin: vec3f,
    vertex: u32,
    goal: vec3f,
    padding: u32,
}

// Leapfrog; exact for linear drag.
fn predict_displacement(p: vec3f, substep: Substep) -> vec3f {
    return p * substep.carry + substep.fall;
}

// The displacement of a pin to its prescribed position at the end of the substep.
fn pin_displacement(pin: Pin, x: vec3f, substep: Substep) -> vec3f {
    return pin.origin + (pin.goal - pin.origin) * substep.end - x;
}
