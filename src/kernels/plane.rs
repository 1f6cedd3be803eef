//! A plane between the two sides of a pair, which none of its corners may cross.
//!
//! Any plane that separates the sides will do. One across the vector between the closest points always does, but where a vertex is
//! beside a triangle of a flat surface, or beyond the end of an edge, it is tilted to the surface, and holds back what slides along
//! it. Therefore other planes are tried where it shortens a displacement: see [`sliding_normals`].
//!
//! What falls on a kinematic side from several thicknesses away must get through half of that distance within the substep, to where the
//! response stops it with friction. A plane halfway would stop it before, without any. So the plane is near such a side:
//! see [`BEFORE_KINEMATIC`].

use glam::Vec3A;

use super::pair::{Kind, PARALLEL, clamp01};
use crate::simd::{Lanes, Vector};

/// The [`clearance`], as a share of the distance between the sides, or of the thickness if that is more.
pub(crate) const CLEARANCE: f32 = 0.05;
/// The sides of a pair must be at least this share of their distance apart along the normal of a plane that is used instead of the
/// one across the vector between their closest points.
pub(crate) const SEPARATES: f32 = 0.03;
/// The plane of a pair with one kinematic side is at most so many thicknesses from that side. Less than a thickness, so that what falls
/// gets to where the response acts; above a half, so that planes of pairs that rest about a thickness apart stay where they are.
pub(crate) const BEFORE_KINEMATIC: f32 = 0.6;
/// Relaxation factor of [`excess`]. It shortens displacements below 2, and below 1 leaves more of them to be truncated.
pub(crate) const SLIDING: f32 = 1.6;

/// A plane between the sides of a pair.
#[derive(Clone, Copy)]
pub(crate) struct Plane<L> {
    /// The unit vector toward the first side.
    pub normal: Vector<L>,
    /// The distance (m) of each corner from the plane, positive on its own side.
    pub heights: [L; 4],
    /// The distance (m) that it keeps.
    pub clearance: L,
}

/// How far the corners of a pair may move without crossing a plane.
#[derive(Clone, Copy)]
pub(crate) struct Held<L> {
    /// The plane where it is [held](Plane::hold) from kinematic corners and they have shifted it.
    pub plane: Plane<L>,
    /// How far (m) corners are about to move toward it, and the share of its displacement that is left to each.
    pub towards: [L; 4],
    pub shares: [L; 4],
    /// How far (m) the plane moves past a corner, or two kinematic sides into each other.
    pub passed_by: L,
}

impl<L: Lanes> Plane<L> {
    /// The plane across a unit vector halfway between the sides, whose corners are at `x` (m).
    #[inline(always)]
    pub(crate) fn halfway(normal: Vector<L>, x: [Vector<L>; 4], thickness: L, kind: Kind) -> Plane<L> {
        let [a, b, c, d] = [L::splat(0.0), normal.dot(x[1] - x[0]), normal.dot(x[2] - x[0]), normal.dot(x[3] - x[0])];
        let (first, second) = if kind == Kind::EdgeEdge { (a.min(b), c.max(d)) } else { (a, b.max(c).max(d)) };
        let middle = (first + second) * L::splat(0.5);
        let of_b = if kind == Kind::EdgeEdge { b - middle } else { middle - b };
        let heights = [a - middle, of_b, middle - c, middle - d];
        Plane { normal, heights, clearance: clearance(first - second, thickness) }
    }

    /// The distance (m) between the sides along the normal.
    #[inline(always)]
    pub(crate) fn gap(&self, kind: Kind) -> L {
        let [a, b, c, d] = self.heights;
        if kind == Kind::EdgeEdge { a.min(b) + c.min(d) } else { a + b.min(c).min(d) }
    }

    /// The plane that is at most [`BEFORE_KINEMATIC`] thicknesses from a side all of whose corners are kinematic, if none of the other
    /// side's are. Also returns 1 if both sides have kinematic corners, otherwise 0.
    #[inline(always)]
    fn before_kinematic(mut self, is_kinematic: [L; 4], thickness: L, kind: Kind) -> (Plane<L>, L) {
        let zero = L::splat(0.0);
        let ([a, b, c, d], [h_a, h_b, h_c, h_d]) = (is_kinematic, self.heights);
        let (any, all, lowest) = match kind {
            Kind::VertexTriangle => ([a, b.max(c).max(d)], [a, b.min(c).min(d)], [h_a, h_b.min(h_c).min(h_d)]),
            Kind::EdgeEdge => ([a.max(b), c.max(d)], [a.min(b), c.min(d)], [h_a.min(h_b), h_c.min(h_d)]),
        };
        let most = thickness * L::splat(BEFORE_KINEMATIC);
        let nearer = |side: usize| (lowest[side] - most).max(zero) * (all[side] - any[1 - side]).max(zero);
        let toward_first = nearer(0) - nearer(1);
        for (k, height) in self.heights.iter_mut().enumerate() {
            *height = if k < kind.first_side() { *height - toward_first } else { *height + toward_first };
        }
        (self, any[0] * any[1])
    }

    /// How far corners with displacements `u` (m) may move. Those for which `is_kinematic` is 1, not 0, are not shortened. As far as
    /// one of them would cross the plane, the plane is shifted; if both sides push, by the difference.
    #[inline(always)]
    pub(crate) fn hold(&self, u: [Vector<L>; 4], is_kinematic: [L; 4], thickness: L, kind: Kind) -> Held<L> {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let (mut plane, mut are_both) = (*self, zero);
        let [a, b, c, d] = is_kinematic;
        if L::any(zero.lt((a + b) + (c + d))) {
            (plane, are_both) = self.before_kinematic(is_kinematic, thickness, kind);
        }
        let Plane { normal, heights, clearance } = plane;
        let of_first = [true, kind == Kind::EdgeEdge, false, false];
        let (mut towards, mut pushes) = ([zero; 4], [zero; 2]);
        for k in 0..4 {
            let along = normal.dot(u[k]);
            towards[k] = if of_first[k] { zero - along } else { along };
            let push = &mut pushes[usize::from(!of_first[k])];
            *push = push.max((clearance - (heights[k] - towards[k])).max(zero) * is_kinematic[k]);
        }
        let shift = pushes[1] - pushes[0];
        let (mut shares, mut passed_by) = ([one; 4], (pushes[1] + pushes[0] - clearance - clearance).max(zero) * are_both);
        for k in 0..4 {
            let height = heights[k] + if of_first[k] { zero - shift } else { shift };
            let is_held = zero.lt(is_kinematic[k]);
            plane.heights[k] = height;
            shares[k] = L::select(is_held, one, share_above(height, clearance, towards[k]));
            passed_by = passed_by.max(L::select(is_held, zero, zero - height));
        }
        Held { plane, towards, shares, passed_by }
    }

    /// Whether the plane stays between the sides of a pair without kinematic corners if it moves along with it: the corners are on
    /// their sides, and at the end those of both that are nearest to each other are still farther apart than twice the clearance.
    /// Paths and plane are straight, so that it also holds in between.
    #[inline(always)]
    pub(crate) fn stays_between(&self, towards: [L; 4], kind: Kind) -> L::Mask {
        let [a, b, c, d] = self.heights;
        let lowest = a.min(b).min(c.min(d));
        let mut end = *self;
        for (height, toward) in end.heights.iter_mut().zip(towards) {
            *height = *height - toward;
        }
        L::and(L::splat(0.0).lt(lowest), (self.clearance + self.clearance).lt(end.gap(kind)))
    }

    /// How far corners may move without crossing the plane that leaves the largest share to the one that is shortened most: this one,
    /// by which they are `held`, or another that separates the sides.
    #[inline(always)]
    pub(crate) fn least_shortening(
        self,
        mut held: Held<L>,
        x: [Vector<L>; 4],
        (u, is_kinematic): ([Vector<L>; 4], [L; 4]),
        thickness: L,
        kind: Kind,
    ) -> Held<L> {
        let least_gap = self.gap(kind) * L::splat(SEPARATES);
        for normal in sliding_normals(self.normal, x, u, kind) {
            let plane = Plane::halfway(normal, x, thickness, kind);
            let by = plane.hold(u, is_kinematic, thickness, kind);
            let shortens_less = L::and(L::eq(by.passed_by, held.passed_by), held.least_share().lt(by.least_share()));
            let is_better = L::or(by.passed_by.lt(held.passed_by), shortens_less);
            held = Held::select(L::and(is_better, least_gap.lt(plane.gap(kind))), by, held);
        }
        held
    }
}

impl<L: Lanes> Held<L> {
    /// `yes` in the lanes of the mask, `no` in the others.
    #[inline(always)]
    fn select(mask: L::Mask, yes: Held<L>, no: Held<L>) -> Held<L> {
        let mut held = no;
        held.plane.normal = Vector::select(mask, yes.plane.normal, no.plane.normal);
        held.plane.clearance = L::select(mask, yes.plane.clearance, no.plane.clearance);
        held.passed_by = L::select(mask, yes.passed_by, no.passed_by);
        for k in 0..4 {
            held.plane.heights[k] = L::select(mask, yes.plane.heights[k], no.plane.heights[k]);
            held.towards[k] = L::select(mask, yes.towards[k], no.towards[k]);
            held.shares[k] = L::select(mask, yes.shares[k], no.shares[k]);
        }
        held
    }

    #[inline(always)]
    pub(crate) fn least_share(&self) -> L {
        let [a, b, c, d] = self.shares;
        a.min(b).min(c.min(d))
    }
}

/// The normals of planes along which the sides of a pair with displacements `u` (m) may slide, given the direction of the vector
/// between their closest points. One is that vector turned until their relative displacement lies in the plane, the other
/// perpendicular to the triangle, or to both edges (if these are parallel, to them and the relative displacement). On a flat surface
/// at least one is about perpendicular to it. They may be 0.
#[inline(always)]
pub(crate) fn sliding_normals<L: Lanes>(apart: Vector<L>, x: [Vector<L>; 4], u: [Vector<L>; 4], kind: Kind) -> [Vector<L>; 2] {
    let (zero, tiny) = (L::splat(0.0), L::splat(1e-30));
    let (way, across) = if kind == Kind::EdgeEdge {
        let (way, first, second) = (u[0] + u[1] - u[2] - u[3], x[1] - x[0], x[3] - x[2]);
        let across = first.cross(second);
        let is_parallel = across.dot(across).lt(first.dot(first) * second.dot(second) * L::splat(PARALLEL));
        (way, Vector::select(is_parallel, first.cross(way), across))
    } else {
        (u[0] - (u[1] + u[2] + u[3]) * L::splat(1.0 / 3.0), (x[2] - x[1]).cross(x[3] - x[1]))
    };
    let along = apart - way * (apart.dot(way) / way.dot(way).max(tiny));
    let across = Vector::select(across.dot(apart).lt(zero), Vector::zero() - across, across);
    let unit = |v: Vector<L>| v * (L::splat(1.0) / v.length().max(tiny));
    [unit(along), unit(across)]
}

/// The distance (m) that a vertex keeps to the plane between sides that are `distance` (m) apart, for cloth of a `thickness` (m).
#[inline(always)]
pub(crate) fn clearance<L: Lanes>(distance: L, thickness: L) -> L {
    let (half, most) = (distance * L::splat(0.5), thickness * L::splat(CLEARANCE));
    (distance * L::splat(CLEARANCE)).max(L::select(half.lt(most), half, most))
}

/// The largest share of a displacement that may be taken. The displacement brings a vertex at `height` (m) above a
/// plane nearer to it by `toward` (m), and it has to stay `clearance` (m) above.
#[inline(always)]
pub(crate) fn share_above<L: Lanes>(height: L, clearance: L, toward: L) -> L {
    let cuts = L::and(L::splat(0.0).lt(toward), (height - toward).lt(clearance));
    L::select(cuts, clamp01((height - clearance) / toward), L::splat(1.0))
}

/// What is to be removed (m) from a displacement `u` so that it slides along planes, instead of being shortened as a whole.
///
/// If `n_k u` may be at most `l_k` and is `e_k` more, the mean of these conditions with weights `e_k` is `a u <= b`, where
/// `a = sum_k e_k n_k`, which `u` exceeds by `sum_k e_k^2`. So it is projected onto that plane (surrogate constraints: Yang and
/// Murty 1992, "New iterative methods for linear inequalities"), and beyond it.
#[inline(always)]
pub(crate) fn excess(weighted: Vec3A, squares: f32) -> Vec3A {
    weighted * (SLIDING * squares / weighted.length_squared().max(1e-30))
}

#[cfg(test)]
#[path = "../../tests/unit/kernels_plane.rs"]
mod tests;
