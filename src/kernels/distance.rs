//! The distance constraint of an edge.

use bytemuck::{Pod, Zeroable};

use crate::simd::{Lanes, Vector};

/// An edge with coefficients for substeps of one length.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Edge {
    pub a: u32,
    pub b: u32,
    /// One over the rest length (1/m).
    pub inverse_rest: f32,
    /// `1 / (w_a + w_b + a')` (kg), where `a'` is the shifted compliance divided by `h²`; of coarse edges that are swept several times
    /// [`OVER_RELAXATION`](crate::multigrid::hierarchy::OVER_RELAXATION) times that.
    pub inverse_weight: f32,
}

/// An edge is corrected along its direction at the substep's start (SHAKE) if it has turned by less than this (the product
/// of its vectors at the substep's start and end, over its squared rest length; 60 degrees at rest length) ...
pub(crate) const TURN_GUARD: f32 = 0.5;
/// ... and its squared length is within this share of the rest value, at the substep's start and end (.75 to 1.2 of the
/// rest length). A longer edge would throw the cloth about if corrected along a direction that is no longer its own.
pub(crate) const STRETCH_GUARD: f32 = 0.44;
/// With [`hold_coarse`], a coarse edge pushes while its squared length is below the rest value by less than this share,
/// and pushes less the closer it is to that limit.
pub(crate) const TAUT_BAND: f32 = 6.5e-4;
/// With [`project_coarse`], a coarse edge whose squared length is below the rest value by this share is slack, and may be shortened
/// further: folds form there. Within the band cloth does not roll up. With all levels a wider one would stretch a flag in a gale more
/// (`a_flag_in_a_gale_stays_a_flag`). If the coarser levels, whose edges span the cloth, are not in use, the finest ones need a wider one.
pub(crate) const SLACK_BAND: f32 = 0.012;
pub(crate) const SLACK_BAND_OF_FEW: f32 = 0.05;
/// A coarse edge undoes all of what others shorten it by, but at most one over this times as much as it would take away of an excess of the
/// same size. So edges without stiffness do not push.
pub(crate) const LEAST_PART: f32 = 0.02;
/// Lower bound of lengths (m) that are used as divisors.
pub(crate) const MIN_LENGTH: f32 = 1e-12;

/// The correction of an edge. Its impulse is `-scale * inverse_weight * direction`: add `w_a` times that to `u_a` and
/// subtract `w_b` times it from `u_b`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EdgeCorrection<L: Lanes> {
    /// The excess length relative to the length of the direction vector.
    pub scale: L,
    /// Where set, the direction is `d0`, the edge vector at the substep's start; elsewhere it is `d0 + du`, the current
    /// one.
    pub at_start: L::Mask,
}

/// The correction of an edge between vertices that are apart by `d0` (m) at the substep's start and move apart by `du`
/// (m) in it.
///
/// The constraint is `C = l - l0`. It is corrected along the edge's direction at the substep's start (SHAKE: Ryckaert
/// et al. 1977), or along its current direction (XPBD: Macklin et al. 2016) if the edge has turned or stretched far. Only
/// an impulse along the direction at the start exerts no torque about any point. One along the current direction turns
/// the edge by `d0 x du`, so that a cloth hung by one pin whose edges stretch would slowly start to spin.
///
/// `l - l0` is a polynomial in `r = (l/l0)² - 1`, and the inverse of the length at the start is one too. So the common
/// case needs no square root, and the rest length cancels. Without the second polynomial the edge would be stiffer by a
/// share equal to its strain, at any number of substeps.
#[inline(always)]
pub(crate) fn project_edge<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> EdgeCorrection<L> {
    let lengths = Lengths::new(d0, du, inverse_rest);
    correct(lengths, excess_length(lengths.r), [d0, du], inverse_rest)
}

/// The correction of a coarse edge that only pulls: the centers of aggregates may come arbitrarily close. For cloth without pins.
#[inline(always)]
pub(crate) fn pull_coarse<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> EdgeCorrection<L> {
    let mut lengths = Lengths::new(d0, du, inverse_rest);
    let is_slack = lengths.r.lt(L::splat(0.0));
    // Without a correction the direction is irrelevant, and the path with a root is not needed.
    lengths.at_start = L::or(lengths.at_start, is_slack);
    let mut correction = correct(lengths, excess_length(lengths.r), [d0, du], inverse_rest);
    correction.scale = L::select(is_slack, L::splat(0.0), correction.scale);
    correction
}

/// The correction of a coarse edge whose ends were predicted to move apart by `predicted` (m), in cloth with pins and bending stiffness. It
/// pulls, and what other corrections shorten it below the predicted length it undoes, the less the more slack it is, and nothing
/// where its squared length is below the rest value by the share `1/per_slack` ([`SLACK_BAND`], [`SLACK_BAND_OF_FEW`]).
///
/// A pull takes away `part` of an excess: less than all where the substep resolves the stiffness of the coarse edge, more than all if it
/// is over-relaxed, but not of an edge that has turned or stretched far, because slack of that is not undone. What others shorten it by in
/// the same substep, and what it did too much, is no deformation of the cloth, so all of that is undone ([`LEAST_PART`]).
///
/// In hanging cloth diagonal coarse edges are stretched by the load, and pull the cloth together across it. If no coarse edge across
/// resisted that, fine edges would. They buckle under the pressure within an aggregate, where coarse edges have no influence, so that a
/// breeze rolls up cloth. A push from a fixed length would resist bending, which shortens the chord between two aggregates; the
/// predicted length follows the bend. Cloth that does not hang has no such load, and this would keep it moving where it has crumpled on a
/// floor (`crumpled_cloth_comes_to_rest_at_few_substeps`).
#[inline(always)]
pub(crate) fn project_coarse<L: Lanes>(
    d0: Vector<L>,
    du: Vector<L>,
    predicted: Vector<L>,
    inverse_rest: L,
    part: L,
    per_slack: f32,
) -> EdgeCorrection<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let before = relative_excess(d0 + predicted, inverse_rest).min(zero);
    let left = before.mul_add(L::splat(per_slack), one).max(zero);
    let mut lengths = Lengths::new(d0, du, inverse_rest);
    let r = lengths.r;
    let (is_slack, pushes) = (r.lt(zero), L::and(lengths.at_start, r.lt(before)));
    let push = (excess_length(r) - excess_length(before)) * left / part.max(L::splat(LEAST_PART));
    // Without a correction the direction is irrelevant, and the path with a root is not needed.
    lengths.at_start = L::or(lengths.at_start, is_slack);
    let mut correction = correct(lengths, L::select(is_slack, push, excess_length(r)), [d0, du], inverse_rest);
    let scale = L::select(correction.at_start, correction.scale, correction.scale / part.max(one));
    correction.scale = L::select(pushes, scale, L::select(is_slack, zero, scale));
    correction
}

/// The correction of a coarse edge that pulls, and also pushes a little while it is hardly compressed, for cloth without bending
/// stiffness.
///
/// Such cloth would never come to rest for the reason given at [`project_coarse`], which ends that too, but leaves a fifth to two
/// fifths more mean strain in a sheet that swings down. The push fades out within [`TAUT_BAND`] and derives from a potential. It acts as a
/// small bending resistance.
#[inline(always)]
pub(crate) fn hold_coarse<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> EdgeCorrection<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let mut lengths = Lengths::new(d0, du, inverse_rest);
    let r = lengths.r;
    let is_slack = r.lt(L::splat(-TAUT_BAND));
    lengths.at_start = L::or(lengths.at_start, is_slack);
    let mut correction = correct(lengths, excess_length(r), [d0, du], inverse_rest);
    let left = r.mul_add(L::splat(1.0 / TAUT_BAND), one);
    correction.scale = L::select(r.lt(zero), correction.scale * left * left, correction.scale);
    correction.scale = L::select(is_slack, zero, correction.scale);
    correction
}

/// The correction of an edge along its current direction. For an edge without compliance this is Jakobsen's relaxation
/// (2001).
#[inline(always)]
pub(crate) fn relax_edge<L: Lanes>(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> EdgeCorrection<L> {
    let nowhere = L::splat(0.0).lt(L::splat(0.0));
    let (d, one) = (d0 + du, L::splat(1.0));
    let length = d.dot(d).sqrt().max(L::splat(MIN_LENGTH));
    EdgeCorrection { scale: one - one / (inverse_rest * length), at_start: nowhere }
}

/// `(l/l0)² - 1` of an edge vector.
#[inline(always)]
fn relative_excess<L: Lanes>(d: Vector<L>, inverse_rest: L) -> L {
    d.dot(d).mul_add(inverse_rest * inverse_rest, L::splat(-1.0))
}

/// `(l/l0)² - 1` of an edge at the substep's start and end, and where it is corrected along its direction at the start.
#[derive(Clone, Copy)]
struct Lengths<L: Lanes> {
    r0: L,
    r: L,
    at_start: L::Mask,
}

impl<L: Lanes> Lengths<L> {
    #[inline(always)]
    fn new(d0: Vector<L>, du: Vector<L>, inverse_rest: L) -> Lengths<L> {
        let d = d0 + du;
        let (r0, r) = (relative_excess(d0, inverse_rest), relative_excess(d, inverse_rest));
        let c = d0.dot(d) * (inverse_rest * inverse_rest);
        let guard = L::splat(STRETCH_GUARD);
        // Both are compared, because taking a maximum first could drop a NaN.
        let hardly_stretched = L::and(r.abs().lt(guard), r0.abs().lt(guard));
        Lengths { r0, r, at_start: L::and(L::splat(TURN_GUARD).lt(c), hardly_stretched) }
    }
}

/// The correction of an excess length relative to the rest length, or where the edge has turned or stretched far [`relax_edge`].
#[inline(always)]
fn correct<L: Lanes>(lengths: Lengths<L>, excess: L, [d0, du]: [Vector<L>; 2], inverse_rest: L) -> EdgeCorrection<L> {
    let Lengths { r0, at_start, .. } = lengths;
    let mut scale = inverse_length(r0) * excess;
    if !L::all(at_start) {
        scale = L::select(at_start, scale, relax_edge(d0, du, inverse_rest).scale);
    }
    EdgeCorrection { scale, at_start }
}

/// `(l - l0)/l0` of an edge with `r = (l/l0)² - 1`, within 1.3e-4 of it where `|r|` is less than [`STRETCH_GUARD`]: the
/// Taylor series of `sqrt(1 + r) - 1` up to the cubic term, and two terms fitted to the rest.
#[inline(always)]
fn excess_length<L: Lanes>(r: L) -> L {
    let rest = r.mul_add(L::splat(0.0307), L::splat(-0.0429)).mul_add(r, L::splat(0.0625));
    r * rest.mul_add(r, L::splat(-0.125)).mul_add(r, L::splat(0.5))
}

/// `l0/l` of an edge with `r = (l/l0)² - 1`, within 8e-4 of it where `|r|` is less than [`STRETCH_GUARD`]: the Taylor
/// series of `1/sqrt(1 + r)` up to the square, and two terms fitted to the rest.
#[inline(always)]
fn inverse_length<L: Lanes>(r: L) -> L {
    let rest = r.mul_add(L::splat(0.321), L::splat(-0.360)).mul_add(r, L::splat(0.375));
    rest.mul_add(r, L::splat(-0.5)).mul_add(r, L::splat(1.0))
}

#[cfg(test)]
#[path = "../../tests/unit/kernels_distance.rs"]
mod tests;
