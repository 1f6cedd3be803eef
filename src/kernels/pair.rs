//! A pair of features that may collide: a vertex and a triangle, or two edges. Either way it has four corners with a
//! weight each.
//!
//! The weights are the barycentric coordinates of the closest points, positive on one side (sum 1) and negative on the
//! other (sum -1). So `sum_i weight_i x_i` is the vector from the second side to the first, `sum_i weight_i u_i` is
//! their relative displacement, and both kinds of pairs are treated alike.

use crate::simd::{Lanes, Vector};

/// Relaxation factor of the Jacobi iterations over pairs, apart from the last of a substep; it is stable below 2 (see
/// [`step_of_lambda`]).
///
/// The last one is not over-relaxed. Where the bound on a pair is exact, as for cloth that lies flat on a body, an over-relaxed iteration
/// leaves `1 - RELAXATION` of what it is to end. After four that is a quarter of an impact's velocity, with any number of substeps: in the
/// next one cloth rebounded at 8 % of it, and friction turned back what it had stopped. An iteration that is not leaves nothing.
pub(crate) const RELAXATION: f32 = 1.7;
/// Share of the thickness by which a pair may be too close without being corrected: see [`separation`].
pub(crate) const SLACK: f32 = 0.01;
/// A pair that is too close by more than a share `DEEP` of its thickness loses a share of its multipliers per substep, which is
/// `UNWINDING` times the rest of its depth, in thicknesses: see [`warm_share`].
pub(crate) const DEEP: f32 = 0.2;
pub(crate) const UNWINDING: f32 = 0.125;

/// A pair with a kinematic side (of a pin or a mesh collider) is squeezed if it is too close by more than this share of its
/// thickness at the end of a step: if there were room, the kinematic side would have pushed the other one out.
pub(crate) const SQUEEZED: f32 = 0.3;

/// A triangle counts as degenerate if the squared sine of the angle between two sides is below this.
pub(crate) const THIN: f32 = 1e-6;
/// Pairs that are closer than this share of their thickness, or whose square distance is less than this share of a side's, are so
/// close that the direction between them is that of [`perpendicular`].
pub(crate) const NARROW: f32 = 0.2;
pub(crate) const LONG: f32 = 1e-6;
/// Two edges count as parallel if the squared sine of the angle between them is below this.
pub(crate) const PARALLEL: f32 = 1e-6;
/// Replaces 0 in comparisons that should include equality.
const TINY: f32 = f32::MIN_POSITIVE;

/// The kinds of pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Kind {
    #[default]
    VertexTriangle,
    EdgeEdge,
}

impl Kind {
    pub(crate) const ALL: [Kind; 2] = [Kind::VertexTriangle, Kind::EdgeEdge];

    /// The weights of the four corners of as many pairs as there are lanes, of which two are given; they sum to 1 on the
    /// first side and -1 on the second.
    #[inline(always)]
    pub(crate) fn weights<L: Lanes>(self, free: L, last: L) -> [L; 4] {
        let one = L::splat(1.0);
        match self {
            Kind::VertexTriangle => [one, L::splat(-1.0) - free - last, free, last],
            Kind::EdgeEdge => [one - free, free, L::splat(-1.0) - last, last],
        }
    }

    /// The number of corners on the first side.
    pub(crate) fn first_side(self) -> usize {
        match self {
            Kind::VertexTriangle => 1,
            Kind::EdgeEdge => 2,
        }
    }
}

/// The sum of the largest value at a corner of either side.
#[inline(always)]
pub(crate) fn sum_of_sides<L: Lanes>(kind: Kind, [a, b, c, d]: [L; 4]) -> L {
    match kind {
        Kind::VertexTriangle => a + b.max(c).max(d),
        Kind::EdgeEdge => a.max(b) + c.max(d),
    }
}

/// Whether a number is at most 0.
#[inline(always)]
fn down<L: Lanes>(t: L) -> L::Mask {
    t.lt(L::splat(TINY))
}

/// Whether a number is at least 0.
#[inline(always)]
fn up<L: Lanes>(t: L) -> L::Mask {
    L::splat(-TINY).lt(t)
}

#[inline(always)]
pub(crate) fn clamp01<L: Lanes>(t: L) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let t = t.max(zero);
    L::select(t.lt(one), t, one)
}

/// The parameter, from 0 to 1, of the point on the segment `b` that is nearest to `a`; both start at the origin.
#[inline(always)]
fn along<L: Lanes>(a: Vector<L>, b: Vector<L>) -> L {
    clamp01(a.dot(b) / square(b).max(L::splat(1e-30)))
}

#[inline(always)]
pub(crate) fn square<L: Lanes>(a: Vector<L>) -> L {
    a.dot(a)
}

#[inline(always)]
fn choose<L: Lanes>(mask: L::Mask, yes: (L, L), no: (L, L)) -> (L, L) {
    (L::select(mask, yes.0, no.0), L::select(mask, yes.1, no.1))
}

/// The weights of the closest points of a vertex and a triangle (Ericson 2004, "Real-Time Collision Detection", 5.1.5).
#[inline(always)]
pub(crate) fn vertex_triangle<L: Lanes>([p, a, b, c]: [Vector<L>; 4]) -> [L; 4] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let (ab, ac, ap, bp, cp) = (b - a, c - a, p - a, p - b, p - c);
    let (d1, d2, d3, d4, d5, d6) = (ab.dot(ap), ac.dot(ap), ab.dot(bp), ac.dot(bp), ab.dot(cp), ac.dot(cp));
    let (va, vb, vc) = (d5.neg_mul_add(d4, d3 * d6), d1.neg_mul_add(d6, d5 * d2), d3.neg_mul_add(d2, d1 * d4));
    let inside = one / (va + vb + vc);
    let weights = (vb * inside, vc * inside);
    let along_bc = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    let weights = choose(L::and(down(va), L::and(up(d4 - d3), up(d5 - d6))), (one - along_bc, along_bc), weights);
    let weights = choose(L::and(down(vb), L::and(up(d2), down(d6))), (zero, d2 / (d2 - d6)), weights);
    let weights = choose(L::and(down(vc), L::and(up(d1), down(d3))), (d1 / (d1 - d3), zero), weights);
    let weights = choose(L::and(up(d6), down(d5 - d6)), (zero, one), weights);
    let weights = choose(L::and(up(d3), down(d4 - d3)), (one, zero), weights);
    let mut weights = choose(L::and(down(d1), down(d2)), (zero, zero), weights);
    // A degenerate triangle has no interior in single precision; use the closest point on its sides.
    let is_wide = (ab.dot(ab) * ac.dot(ac) * L::splat(THIN)).lt(va + vb + vc);
    if !L::all(is_wide) {
        let (s, t, r) = (along(ap, ab), along(ap, ac), along(bp, c - b));
        let (near_ab, near_ac, near_bc) = (square(ap - ab * s), square(ap - ac * t), square(bp - (c - b) * r));
        let sides = choose(near_ac.lt(near_ab), (zero, t), (s, zero));
        let least = L::select(near_ac.lt(near_ab), near_ac, near_ab);
        weights = choose(is_wide, weights, choose(near_bc.lt(least), (one - r, r), sides));
    }
    let (v, w) = weights;
    [one, v + w - one, zero - v, zero - w]
}

/// The weights of the closest points of two edges (Ericson 2004, 5.1.9).
#[inline(always)]
pub(crate) fn edge_edge<L: Lanes>([a0, a1, b0, b1]: [Vector<L>; 4]) -> [L; 4] {
    let (zero, one, tiny) = (L::splat(0.0), L::splat(1.0), L::splat(1e-30));
    let (d1, d2, r) = (a1 - a0, b1 - b0, a0 - b0);
    let (a, e, f, c, b) = (d1.dot(d1).max(tiny), d2.dot(d2).max(tiny), d2.dot(r), d1.dot(r), d1.dot(d2));
    let across = b.neg_mul_add(b, a * e);
    // On parallel edges any pair of nearest points will do.
    let parallel = across.lt(a * e * L::splat(PARALLEL));
    let s = L::select(parallel, zero, clamp01(c.neg_mul_add(e, b * f) / across.max(tiny)));
    let t = clamp01(b.mul_add(s, f) / e);
    // Where the parameter on the second edge was clamped, recompute that on the first.
    let s = clamp01((b * t - c) / a);
    [one - s, s, t - one, zero - t]
}

/// The weights of the closest points of pairs.
#[inline(always)]
pub(crate) fn closest<L: Lanes>(kind: Kind, x: [Vector<L>; 4]) -> [L; 4] {
    match kind {
        Kind::VertexTriangle => vertex_triangle(x),
        Kind::EdgeEdge => edge_edge(x),
    }
}

/// The vector between the closest points.
#[inline(always)]
pub(crate) fn between<L: Lanes>(weights: [L; 4], x: [Vector<L>; 4]) -> Vector<L> {
    x[3].mul_add(weights[3], x[2].mul_add(weights[2], x[1].mul_add(weights[1], x[0] * weights[0])))
}

/// Whether rounding may tilt the vector between the closest points of a pair, of length `distance` (m).
#[inline(always)]
pub(crate) fn is_tilted<L: Lanes>(distance: L, thickness: L, x: [Vector<L>; 4], kind: Kind) -> L::Mask {
    let (first, second) = match kind {
        Kind::VertexTriangle => (x[2] - x[1], x[3] - x[1]),
        Kind::EdgeEdge => (x[1] - x[0], x[3] - x[2]),
    };
    let is_short = (distance * distance).lt(square(first).max(square(second)) * L::splat(LONG));
    L::or(distance.lt(thickness * L::splat(NARROW)), is_short)
}

/// The part of `apart` (m), the vector between the closest points, that is perpendicular to the corners that these
/// points lie between.
///
/// In exact arithmetic that is all of it. In single precision the vector between features that nearly touch is tilted,
/// by the rounding of positions over its length. Over the length of an edge that is more than the distance, so that a
/// plane across the vector would not separate the two sides.
#[inline(always)]
pub(crate) fn perpendicular<L: Lanes>(apart: Vector<L>, weights: [L; 4], x: [Vector<L>; 4], kind: Kind) -> Vector<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let is_used = weights.map(|weight| L::select(L::eq(weight, zero), zero, one));
    let side = |a: usize, b: usize| (x[b] - x[a]) * (is_used[a] * is_used[b]);
    let (first, second) = match kind {
        Kind::EdgeEdge => (side(0, 1), side(2, 3)),
        // Two sides of the triangle if the point is inside, the side on which it is, or none.
        Kind::VertexTriangle => (side(1, 2) + side(2, 3) * (one - is_used[1]), side(1, 3)),
    };
    let without = |v: Vector<L>, t: Vector<L>| v - t * (v.dot(t) / square(t).max(L::splat(1e-30)));
    let across = without(second, first);
    // Parallel sides are one direction.
    let across = across * L::select((square(second) * L::splat(THIN)).lt(square(across)), one, zero);
    without(without(apart, first), across)
}

/// One Jacobi step of a pair's multipliers: `lambda_t`, those of friction, and `lambda_n`, that of the normal (kg m).
///
/// `relative` (m) is the relative displacement of the two sides in this substep, and `gap` (m) how far they may
/// approach. `rate` is [`RELAXATION`], in the last iteration 1, over `D = sum_v w_v |weight_v| N_v`, where `N_v` is the sum of a
/// vertex's weights over all its pairs. `D` bounds the rows of `J W J^T` (Gershgorin), so pairs that all act at once do not overshoot.
/// Coulomb friction bounds the tangential multipliers by `friction` times the normal one.
#[inline(always)]
pub(crate) fn step_of_lambda<L: Lanes>(
    (lambda_t, lambda_n): (Vector<L>, L),
    normal: Vector<L>,
    gap: L,
    relative: Vector<L>,
    rate: L,
    friction: L,
) -> (Vector<L>, L) {
    let along = normal.dot(relative);
    let lambda_n = (lambda_n - rate * (gap + along)).max(L::splat(0.0));
    let slip = relative - normal * along;
    let lambda_t = lambda_t - slip * rate;
    let (length, most) = (square(lambda_t).sqrt(), friction * lambda_n);
    let slips = most.lt(length);
    if L::bits(slips) == 0 {
        return (lambda_t, lambda_n);
    }
    let share = L::select(slips, most / length.max(L::splat(1e-30)), L::splat(1.0));
    (lambda_t * share, lambda_n)
}

/// The impulse (kg m) of a pair's multipliers.
#[inline(always)]
pub(crate) fn impulse<L: Lanes>((lambda_t, lambda_n): (Vector<L>, L), normal: Vector<L>) -> Vector<L> {
    normal.mul_add(lambda_n, lambda_t)
}

/// The distance (m) at which the response holds a pair apart, given the weights of its kinematic corners, and 0 for the others.
///
/// Nothing moves kinematic corners of both sides apart (of a pin and a mesh collider, say), however close they are. So it is the
/// distance of the closest points that free corners a thickness away leave if the kinematic ones touch, on the side on which it is
/// more. A whole thickness would demand of a free corner that it moves by a thickness over its weight, which is any distance next to
/// a pin. It would be corrected by that much in every substep, and the edges would take it back as a velocity, without end.
#[inline(always)]
pub(crate) fn held_distance<L: Lanes>(thickness: L, [a, b, c, d]: [L; 4]) -> L {
    let zero = L::splat(0.0);
    let first = (a.max(zero) + b.max(zero)) + (c.max(zero) + d.max(zero));
    let second = ((zero - a).max(zero) + (zero - b).max(zero)) + ((zero - c).max(zero) + (zero - d).max(zero));
    thickness * (L::splat(1.0) - first.min(second)).max(zero)
}

/// The correction (m) of a pair that is too close by `depth` (m), in a substep in which it may be `most` (m). It is
/// proportional to the depth, so that cloth which is squeezed between two things comes to lie in the middle.
///
/// Pairs at rest lie within the slack. Corrected up to their thickness, a pair that moves by less than a micrometer would
/// lose its multiplier as soon as there is a gap, fall until it has a new one, and be corrected again, without end.
#[inline(always)]
pub(crate) fn separation<L: Lanes>(depth: L, thickness: L, most: L) -> L {
    (depth - thickness * L::splat(SLACK)).max(L::splat(0.0)) * (most / thickness.max(most))
}

/// The share of the last substep's multipliers with which a pair starts that is too close by `depth` (m).
///
/// 1 for pairs that are at most [`DEEP`] thicknesses too close: at rest every reduction would remain as a velocity, because few
/// iterations do not make up for it. Beyond that the share decreases with the depth, so that the multipliers of cloth without
/// room do not grow until they throw it out. A constant factor would hold down compressed stacks: ten sheets stayed at half their
/// height.
#[inline(always)]
pub(crate) fn warm_share<L: Lanes>(depth: L, thickness: L) -> L {
    let deep = (depth - thickness * L::splat(DEEP)).max(L::splat(0.0));
    L::splat(1.0) - deep * (L::splat(UNWINDING) / thickness)
}

#[cfg(test)]
#[path = "../../tests/unit/kernels_pair.rs"]
mod tests;
