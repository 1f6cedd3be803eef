// What the instability watch measures at the end of a step. The derivations are in src/kernels/watch.rs.

const MAX_SQUARE: f32 = 1e30;

fn is_fast(p: vec3f) -> bool {
    let ratio = p * params.per_length;
    return dot(ratio, ratio) > 1.0;
}

fn energy_share(p: vec3f, mass: f32) -> f32 {
    let ratio = p * params.per_length;
    return min(dot(ratio, ratio), MAX_SQUARE) * (mass * params.per_mass);
}

fn is_long(d: vec3f) -> bool {
    return length(d) > params.longest_edge;
}
