// An explicit spring, seen from one of its ends. See src/kernels/spring.rs.

struct Spring {
    other: u32,
    rest: f32,
    stiffness: f32,
}

// The force on the end that `d` points away from.
fn spring_force(d: vec3f, spring: Spring) -> vec3f {
    let l = max(length(d), LEAST_LENGTH);
    return d * (spring.stiffness * (l - spring.rest) / l);
}
