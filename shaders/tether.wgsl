// Tethers: one-sided constraints on the distance between a vertex and a pin. The derivations are in
// src/kernels/tether.rs.

struct Tether {
    anchor: u32,
    length: f32,
    slack: f32,
    share: f32,
}

const TETHER_TURN_GUARD: f32 = 0.5;
const TETHER_SHORT_GUARD: f32 = 0.1;

// The correction of a tethered vertex that is at `d0` from the pin at the substep's start and moves by `du` relative to
// it.
fn tethered(d0: vec3f, du: vec3f, reach: f32, share: f32) -> vec3f {
    let d = d0 + du;
    let l = length(d);
    if l <= reach {
        return vec3f();
    }
    let l0 = length(d0);
    if dot(d0, d) > TETHER_TURN_GUARD * l0 * l && l0 > TETHER_SHORT_GUARD * reach {
        return d0 * (-share * (l - reach) / l0);
    }
    return d * (-share * (l - reach) / max(l, MIN_LENGTH));
}
