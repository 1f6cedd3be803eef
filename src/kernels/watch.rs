//! What a watch looks for at the end of a step: motion that nothing in the scene explains, and edges that are far too long.
//!
//! Both are compared with bounds that [`crate::step::watch`] derives. Kinetic energy is counted in shares of what the bound allows, so
//! that the sum needs no unit: `(m / M) |p / (V h)|²` for a vertex of mass `m` that moved by `p` in a substep `h`, in a cloth of free mass
//! `M` that may move at the root mean square speed `V`. The sum passes 1 where the cloth does.

use glam::Vec3A;

use crate::simd::Lanes;

/// Squares are cut off here, so that no mass makes something endless of them.
pub(crate) const MOST_SQUARE: f32 = 1e30;

/// The share of one component of a displacement `p` (m), of a vertex of mass `mass` (kg), 0 for a pin, which goes where it is led.
/// `per_length` is `1 / (V h)` (1/m), `per_mass` is `1 / M` (1/kg).
#[inline(always)]
pub(crate) fn energy_share<L: Lanes>(p: L, mass: L, per_length: L, per_mass: L) -> L {
    let (most, ratio) = (L::splat(MOST_SQUARE), p * per_length);
    let square = ratio * ratio;
    L::select(square.lt(most), square, most) * (mass * per_mass)
}

/// Whether an edge from end to end (m) is longer than `limit` (m), or not a number.
pub(crate) fn is_long(d: Vec3A, limit: f32) -> bool {
    let length = d.length();
    length.is_nan() || length > limit
}
