// What a vertex will do if nothing holds it. See src/kernels.rs.

struct Pin {
    origin: vec3f,
    vertex: u32,
    goal: vec3f,
    padding: u32,
}

// Leapfrog, exact for linear drag.
fn predict_displacement(p: vec3f, substep: Substep) -> vec3f {
    return p * substep.carry + params.acceleration * substep.gain;
}

// To where the pin is led by the end of the substep.
fn pin_displacement(pin: Pin, x: vec3f, substep: Substep) -> vec3f {
    return pin.origin + (pin.goal - pin.origin) * substep.end - x;
}

// From what is there of its motion: the last displacement, or, if forces have predicted it, this substep's.
fn motion_displacement(motion: vec3f, w: f32, substep: Substep) -> vec3f {
    if params.predicted != 0u {
        return motion;
    }
    return select(predict_displacement(motion, substep), vec3f(), w == 0.0);
}
