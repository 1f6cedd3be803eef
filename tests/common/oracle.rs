//! The kernels of `src/kernels/` once more, written as plainly as possible: scalar, and without series where a square
//! root will do.

#![allow(dead_code, reason = "each test takes what it needs")]

use glam::{DVec3, Mat3A, Vec3A};

/// Near `sqrt(1 + r) - 1`.
fn excess(r: f32) -> f32 {
    r / 2.0 - r.powi(2) / 8.0 + r.powi(3) / 16.0 - 0.0429 * r.powi(4) + 0.0307 * r.powi(5)
}

/// Near `1/sqrt(1 + r)`.
fn inverse_length(r: f32) -> f32 {
    1.0 - r / 2.0 + 3.0 * r.powi(2) / 8.0 - 0.360 * r.powi(3) + 0.321 * r.powi(4)
}

/// `(l/l0)² - 1` of an edge that is at `d0` and moves by `du`, and at its start; none if it has turned or stretched far.
fn guarded(d0: Vec3A, du: Vec3A, inverse_rest: f32) -> Option<(f32, f32)> {
    let square = |d: Vec3A| d.length_squared() * inverse_rest * inverse_rest - 1.0;
    let turn = d0.dot(d0 + du) * inverse_rest * inverse_rest;
    let (r, r0) = (square(d0 + du), square(d0));
    (turn > 0.5 && r.abs() < 0.44 && r0.abs() < 0.44).then_some((r, r0))
}

/// The impulse of an edge: add `w_a` times it to `u_a` and subtract `w_b` times it from `u_b`.
pub fn project_edge(d0: Vec3A, du: Vec3A, inverse_rest: f32, inverse_weight: f32) -> Vec3A {
    match guarded(d0, du, inverse_rest) {
        Some((r, r0)) => -inverse_weight * excess(r) * inverse_length(r0) * d0,
        None => relax_edge(d0, du, inverse_rest, inverse_weight),
    }
}

pub fn pull_coarse(d0: Vec3A, du: Vec3A, inverse_rest: f32, inverse_weight: f32) -> Vec3A {
    if (d0 + du).length() * inverse_rest <= 1.0 { Vec3A::ZERO } else { project_edge(d0, du, inverse_rest, inverse_weight) }
}

/// The same for a coarse edge whose ends were predicted to move apart by `predicted`.
pub fn project_coarse(d0: Vec3A, du: Vec3A, predicted: Vec3A, [inverse_rest, inverse_weight, band, w]: [f32; 4]) -> Vec3A {
    if (d0 + du).length() * inverse_rest >= 1.0 {
        let over = if guarded(d0, du, inverse_rest).is_some() { 1.0 } else { (inverse_weight * w).max(1.0) };
        return project_edge(d0, du, inverse_rest, inverse_weight) / over;
    }
    let before = ((d0 + predicted).length() * inverse_rest).min(1.0).powi(2) - 1.0;
    let left = (1.0 + before / band).max(0.0);
    match guarded(d0, du, inverse_rest) {
        Some((r, r0)) if r < before => {
            (1.0 / w).min(50.0 * inverse_weight) * left * (excess(before) - excess(r)) * inverse_length(r0) * d0
        }
        _ => Vec3A::ZERO,
    }
}

pub fn hold_coarse(d0: Vec3A, du: Vec3A, inverse_rest: f32, inverse_weight: f32) -> Vec3A {
    let slack = 1.0 - (d0 + du).length_squared() * inverse_rest * inverse_rest;
    let share = (1.0 - slack.max(0.0) / 6.5e-4).max(0.0);
    share * share * project_edge(d0, du, inverse_rest, inverse_weight)
}

pub fn relax_edge(d0: Vec3A, du: Vec3A, inverse_rest: f32, inverse_weight: f32) -> Vec3A {
    let d = d0 + du;
    let length = d.length().max(1e-12);
    inverse_weight * (1.0 / inverse_rest - length) / length * d
}

/// The correction of a tethered vertex that is at `d0` from the pin and moves by `du` relative to it.
pub fn tethered(d0: Vec3A, du: Vec3A, reach: f32, share: f32) -> Vec3A {
    let d = d0 + du;
    if d.length() <= reach {
        return Vec3A::ZERO;
    }
    let is_sound = d0.length() > 0.1 * reach && d0.angle_between(d) < std::f32::consts::FRAC_PI_3;
    share * (reach - d.length()) * if is_sound { d0 } else { d }.normalize()
}

/// The moment of a vertex's bending row and the couple of its damping. Each neighbor is given by its offset, the
/// offset's rate of change, and its coefficient.
pub fn bend_moment(ring: &[(Vec3A, Vec3A, f32)], stiffness: f32, tau: f32) -> [Vec3A; 2] {
    let ring = || ring.iter().filter(|neighbor| neighbor.2 != 0.0);
    let y: Vec3A = ring().map(|&(d, _, c)| c * d).sum();
    if tau == 0.0 {
        return [stiffness * y, Vec3A::ZERO];
    }
    let rate: Vec3A = ring().map(|&(_, rate, c)| c * rate).sum();
    let inertia = ring().fold(Mat3A::ZERO, |inertia, &(d, _, _)| {
        inertia + Mat3A::from_diagonal(glam::Vec3::splat(d.length_squared())) - Mat3A::from_cols(d * d.x, d * d.y, d * d.z)
    });
    let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
    if (inertia * (1.0 / trace.max(1e-30))).determinant() < 1e-4 {
        let growth = y.dot(rate) / y.length_squared().max(1e-30);
        return [stiffness * (1.0 + tau * growth) * y, Vec3A::ZERO];
    }
    let omega = inertia.inverse() * ring().map(|&(d, rate, _)| d.cross(rate)).sum::<Vec3A>();
    let resisted = stiffness * tau * (rate - omega.cross(y));
    [stiffness * y + resisted, inertia.inverse() * y.cross(resisted)]
}

/// `P(A) x`, what a filter of `passes` passes makes of `A x`, the kick of a single pass, by Chebyshev polynomials in
/// double precision.
pub fn filtered_kick(x: &[DVec3], passes: usize, kick: impl Fn(&[DVec3]) -> Vec<DVec3>) -> Vec<DVec3> {
    let theta = 3.0_f64.acosh() / passes as f64;
    let (w0, w1) = (theta.cosh(), theta.sinh() / (2.0_f64.sqrt() * passes as f64));
    let shifted = |t: &[DVec3]| -> Vec<DVec3> { t.iter().zip(kick(t)).map(|(t, by)| w0 * t - w1 * by).collect() };
    let (mut last, mut t) = (x.to_vec(), shifted(x));
    for _ in 1..passes {
        let next = shifted(&t).iter().zip(&last).map(|(shifted, last)| 2.0 * shifted - last).collect();
        last = std::mem::replace(&mut t, next);
    }
    x.iter().zip(t).map(|(x, t)| 1.5 * (x - t / 3.0)).collect()
}

/// Aerodynamic force on a triangle with velocity `v` relative to the air. `half_density`, `drag` and `lift` are as in
/// `Params`, and `kick` (s) is the time for which the force acts.
pub fn wind_force(x: [Vec3A; 3], v: Vec3A, mass: f32, kick: f32, half_density: f32, drag: f32, lift: f32) -> Vec3A {
    let cross = (x[1] - x[0]).cross(x[2] - x[0]);
    if cross.length() < 1e-20 {
        return Vec3A::ZERO;
    }
    let (area, n) = (0.5 * cross.length(), cross.normalize());
    let (normal, speed) = (v.dot(n) * n, v.length().max(1e-10));
    let sine = normal.length() / speed;
    let limited = |k: f32| {
        let share = kick * k * area / mass;
        if share < 0.5 { k * area } else { k * area * (share - 0.25) / (share * share) }
    };
    let k_n = limited(half_density * (drag * normal.length() + lift * speed * (1.0 - sine * sine)));
    let k_t = limited(half_density * normal.length() * (drag - lift * sine));
    -(k_n * normal + k_t * (v - normal))
}

/// Signed distance of a point from a rounded box around the origin, whose core has the half extents `core`.
pub fn box_distance(y: DVec3, core: DVec3, radius: f64) -> f64 {
    let outside = y.distance(y.clamp(-core, core));
    let deepest = (0..3).map(|axis| y[axis].abs() - core[axis]).fold(f64::MIN, f64::max);
    if outside > 0.0 { outside - radius } else { deepest - radius }
}

/// Signed distance of a point from the union of all balls between two.
pub fn ball_chain_distance(x: DVec3, ends: [DVec3; 2], radii: [f64; 2]) -> f64 {
    let distance = |t: f64| x.distance(ends[0].lerp(ends[1], t)) - (radii[0] + (radii[1] - radii[0]) * t);
    // Ternary search. There is one minimum, because the distance from a point is convex along a line.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..100 {
        let third = (high - low) / 3.0;
        if distance(low + third) < distance(high - third) { high -= third } else { low += third }
    }
    distance(low)
}
