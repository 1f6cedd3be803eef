// An explicit spring, seen from one of its ends. The derivation is in src/kernels/spring.rs.

struct Spring {
    other: u32,
    rest: f32,
    stiffness: f32,
}

// The force on one end of the spring; `d` points from that end to the other.
fn spring_force(d: vec3f, spring: Spring) -> vec3f {
    let l = max(length(d), MIN_LENGTH);
    return d * (spring.stiffness * (l - spring.rest) / l);
}
