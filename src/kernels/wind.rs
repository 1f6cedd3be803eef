//! Aerodynamic drag and lift, as a force on each triangle.

use bytemuck::{Pod, Zeroable};

use super::params::{Params, Substep};
use crate::simd::{Lanes, Vector};

/// A triangle that is exposed to the air.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Panel {
    pub corners: [u32; 3],
    /// The mass (kg) that the force is limited for: the triangle's area times the least areal density at its corners.
    pub mass: f32,
}

/// The aerodynamic force (N) on a triangle (Keckeisen et al. 2004). Let `v` be its velocity relative to the air, `v_n`
/// and `v_t` the parts of it along and across the normal, and `s = |v_n|/|v|`. Drag is `-rho/2 A C_D |v_n| v`, along
/// the flow. Lift is `-rho/2 A C_L |v| (v_n - s² v)`, across it and greatest at 45 degrees.
///
/// Both are combined as `-A (k_n v_n + k_t v_t)`, with each `k` [`limited`] so that the force never reverses the relative
/// velocity, however strong the wind.
#[inline(always)]
pub(crate) fn wind_force<L: Lanes>(
    x: [Vector<L>; 3],
    velocity: Vector<L>,
    mass: L,
    substep: &Substep,
    params: &Params,
) -> Vector<L> {
    let one = L::splat(1.0);
    let cross = (x[1] - x[0]).cross(x[2] - x[0]);
    let double_area = cross.dot(cross).sqrt();
    let n = cross * (one / double_area);
    let area = double_area * L::splat(0.5);
    let relative = velocity - Vector::splat(params.wind);
    let along = n.dot(relative);
    let normal = n * along;
    let tangential = relative - normal;
    let speed = relative.dot(relative).sqrt().max(L::splat(1e-10));
    let (along, half_density) = (along.abs(), L::splat(params.half_density));
    let sine = along / speed;
    let (drag, lift) = (L::splat(params.drag), L::splat(params.lift));
    let kick = L::splat(substep.gain / params.h) * area / mass;
    let k_n = half_density * drag.mul_add(along, lift * speed * sine.neg_mul_add(sine, one));
    let k_t = half_density * along * lift.neg_mul_add(sine, drag);
    let force = normal.mul_add(limited(k_n, area, kick), tangential * limited(k_t, area, kick));
    let flat = double_area.lt(L::splat(1e-20));
    Vector::select(flat, Vector::zero(), force * L::splat(-1.0))
}

/// `k A` times a factor of `s = kick k A/m`, given `kick A/m`, where `kick` (s) is the time for which the force acts. It takes
/// the share `s` of the relative velocity, of which the force is a quadratic function. The factor is 1 up to `s = 1/2`, so that
/// the air carries what gravity and the cloth put on it; from there on it is `(1 - 1/(4s))/s`, with which the velocity after the
/// kick neither reverses nor decreases as the velocity before increases.
#[inline(always)]
fn limited<L: Lanes>(k: L, area: L, kick: L) -> L {
    let per_share = L::splat(1.0) / (k * kick).max(L::splat(0.5));
    k * area * per_share * per_share.neg_mul_add(L::splat(0.25), L::splat(1.0))
}
