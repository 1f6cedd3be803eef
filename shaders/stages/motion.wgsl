// A vertex's displacement in this substep as predicted: `motion` is that already if forces were added to it, else the last one.
fn motion_displacement(motion: vec3f, w: f32, substep: Substep) -> vec3f {
    if params.predicted != 0u {
        return motion;
    }
    return select(predict_displacement(motion, substep), vec3f(), w == 0.0);
}
