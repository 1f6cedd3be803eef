//! What the instability watch measures at the end of a step: kinetic energy that nothing in the scene explains, and
//! edges that are far too long.
//!
//! The bounds are derived in [`crate::step::watch`]. Kinetic energy is summed in shares of the allowed energy, which
//! are dimensionless: `(m / M) |p / (V h)|²` for a vertex of mass `m` that moved by `p` in a substep `h`, in a cloth of
//! total free mass `M` whose greatest allowed RMS speed is `V`. Only vertices faster than `V` are added up, which hardly
//! any scene has; the others together have at most the allowed energy. The cloth is too fast if the sum exceeds 1.

use glam::Vec3A;

use crate::simd::Lanes;

/// Upper bound of the squares, so that their product with a mass stays finite.
pub(crate) const MAX_SQUARE: f32 = 1e30;

/// The share of the allowed kinetic energy of one component of a displacement `p` (m). `mass` (kg) is 0 for pins, whose
/// motion is prescribed. `per_length` is `1 / (V h)` (1/m), `per_mass` is `1 / M` (1/kg).
#[inline(always)]
pub(crate) fn energy_share<L: Lanes>(p: L, mass: L, per_length: L, per_mass: L) -> L {
    let (most, ratio) = (L::splat(MAX_SQUARE), p * per_length);
    let square = ratio * ratio;
    L::select(square.lt(most), square, most) * (mass * per_mass)
}

/// Whether an edge vector (m) is longer than `limit` (m) or contains a NaN.
pub(crate) fn is_long(d: Vec3A, limit: f32) -> bool {
    let length = d.length();
    length.is_nan() || length > limit
}
