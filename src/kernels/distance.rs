//! Edges: how far apart their ends may be.

use bytemuck::{Pod, Zeroable};

use crate::simd::{Lanes, Vector};

/// An edge, ready for one length of substep.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Edge {
    pub a: u32,
    pub b: u32,
    /// One over the rest length (1/m).
    pub inverse_rest: f32,
    /// `1 / (w_a + w_b + a')` (kg), `a'` the shifted compliance over `h²`.
    pub inverse_weight: f32,
}

/// SHAKE's direction is used while the edge has turned by less than this (cosine) ...
pub(crate) const TURN_GUARD: f32 = 0.9;
/// ... and its squared length is within this share of its rest value, at the substep's start and end.
pub(crate) const STRETCH_GUARD: f32 = 0.1;
/// The direction at the start is kept, with a square root, while the edge has turned by less than this (cosine: 60 degrees) ...
pub(crate) const FAR_TURN_GUARD: f32 = 0.5;
/// ... is longer than this share of its rest length, at the substep's start and end ...
pub(crate) const SHORT_GUARD: f32 = 0.1;
/// ... and ends no longer than this: farther off, a direction that is not its own throws it about.
pub(crate) const LONG_GUARD: f32 = 1.2;
/// A coarse edge that holds pushes while it is slack by less than this share of its squared length, the less the slacker it is.
pub(crate) const SLACK_BAND: f32 = 6.5e-4;
/// No edge is shorter (m) where its length divides.
pub(crate) const LEAST_LENGTH: f32 = 1e-12;

/// What an edge asks of its ends: its impulse is `-scale * inverse_weight * direction`. Add `w_a` times it to `u_a`, subtract
/// `w_b` times it from `u_b`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Correction<L: Lanes> {
    /// How much of the direction is too much.
    pub scale: L,
    /// Where the direction is `d0`, the edge's at the start of the substep; elsewhere it is `d0 + du`, its current one.
    pub at_start: L::Mask,
}

/// The correction of an edge with ends apart by `d0` (m) at the start of the substep, which move apart by `du` (m).
///
/// `C = l - l0`, corrected along the edge's direction at the substep's start (SHAKE: Ryckaert et al. 1977) unless the edge has turned
/// far, or is very short or long, else along its current direction (XPBD: Macklin et al. 2016). Only an impulse along the direction at the
/// start has no torque about any point: one along the current direction turns the edge by `d0 x du`, and a cloth on one pin
/// whose edges stretch would slowly begin to spin.
///
/// While the edge has hardly turned or stretched, `l - l0` is a series in `r = (l/l0)² - 1`, and so is one over the length at the start:
/// the common case has no square root, and the rest length cancels. Without the second series the edge would be stiffer by
/// its own strain, at every substep; its guard keeps it from the edges of a scrambled cloth, where it diverges.
#[inline(always)]
pub(crate) fn project_edge<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> Correction<L> {
    project::<L, false>(d0, du, inverse_rest)
}

/// The correction of a coarse edge, which only pulls: centers of cloth may come as near as they like.
#[inline(always)]
pub(crate) fn project_coarse<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> Correction<L> {
    project::<L, true>(d0, du, inverse_rest)
}

/// The correction of a coarse edge that holds: it pulls, and pushes a little as long as it is hardly slack.
///
/// In a sheet that hangs at rest, coarse diagonals pull the cloth together across the load. If no coarse edge across took that up,
/// fine edges would: pressed, they buckle within an aggregate, where no coarse edge has a say, and a sheet that does not resist
/// bending never comes to rest. The push fades with [`SLACK_BAND`] and has a potential. It resists bending by as little; so it is for cloth that
/// does not bend against any resistance of its own.
#[inline(always)]
pub(crate) fn hold_coarse<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> Correction<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let mut correction = project::<L, false>(d0, du, inverse_rest);
    let d = d0 + du;
    let r = d.dot(d).mul_add(inverse_rest * inverse_rest, L::splat(-1.0));
    let left = r.mul_add(L::splat(1.0 / SLACK_BAND), one).max(zero);
    correction.scale = L::select(r.lt(zero), correction.scale * left * left, correction.scale);
    correction
}

/// The correction of an edge along its current direction: Jakobsen's relaxation (2001) where the edge has no compliance.
#[inline(always)]
pub(crate) fn relax_edge<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> Correction<L> {
    let nowhere = L::splat(0.0).lt(L::splat(0.0));
    let (d, one) = (d0 + du, L::splat(1.0));
    let length = d.dot(d).sqrt().max(L::splat(LEAST_LENGTH));
    Correction { scale: one - one / (inverse_rest * length), at_start: nowhere }
}

/// [`project_edge`], and if `PULL`, [`project_coarse`].
#[inline(always)]
fn project<L: Lanes, const PULL: bool>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> Correction<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let d = d0 + du;
    let less_one = L::splat(-1.0);
    let inverse_square = inverse_rest * inverse_rest;
    let r = d.dot(d).mul_add(inverse_square, less_one);
    let r0 = d0.dot(d0).mul_add(inverse_square, less_one);
    let c = d0.dot(d) * inverse_square;
    let guard = L::splat(STRETCH_GUARD);
    // Each compared by itself: a maximum would let a NaN pass.
    let hardly_stretched = L::and(r.abs().lt(guard), r0.abs().lt(guard));
    let mut at_start = L::and(L::splat(TURN_GUARD).lt(c), hardly_stretched);
    let slack = r.lt(zero);
    if PULL {
        // What is slack is left alone, whichever way it points.
        at_start = L::or(at_start, slack);
    }
    // 1 - r0 (1/2 - 3/8 r0), which is l0 over the length at the start, and r (1/2 - r (1/8 - r/16)), which is (l - l0)/l0.
    let unit = r0.neg_mul_add(r0.neg_mul_add(L::splat(0.375), L::splat(0.5)), one);
    let inner = r.neg_mul_add(r.neg_mul_add(L::splat(0.0625), L::splat(0.125)), L::splat(0.5));
    let mut scale = unit * r * inner;
    if !L::all(at_start) {
        let (stretch0, stretch) = (inverse_rest * d0.dot(d0).sqrt(), inverse_rest * d.dot(d).sqrt());
        let short = L::splat(SHORT_GUARD);
        let sound = L::and(L::and(short.lt(stretch0), short.lt(stretch)), stretch.lt(L::splat(LONG_GUARD)));
        let hardly_turned = L::and((L::splat(FAR_TURN_GUARD) * stretch0 * stretch).lt(c), sound);
        // (l - l0)/l, or over the length of the direction that is taken.
        let length = L::select(hardly_turned, stretch0, stretch.max(inverse_rest * L::splat(LEAST_LENGTH)));
        scale = L::select(at_start, scale, (stretch + less_one) / length);
        at_start = L::or(at_start, hardly_turned);
    }
    if PULL {
        scale = L::select(slack, zero, scale);
    }
    Correction { scale, at_start }
}
