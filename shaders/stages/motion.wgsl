// A vertex's predicted displacement in this substep. `motion` already is that if a prediction stage ran, otherwise it
// is the last displacement.
fn motion_displacement(motion: vec3f, w: f32, substep: Substep) -> vec3f {
    if params.predicted != 0u {
        return motion;
    }
    return select(predict_displacement(motion, substep), vec3f(), w == 0.0);
}
