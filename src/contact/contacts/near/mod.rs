//! Near pairs: the listed pairs that may come closer than their thickness in this substep, with the data of their
//! contact.

pub(super) mod approach;
pub(super) mod group;
pub(super) mod portions;
pub(crate) mod voronoi;

use glam::Vec4;

use crate::contact::surface::lanes::{corners_of, number, store, store_vector, vector, whole_corners_of};
use crate::contact::surface::pairs::reach;
use crate::kernels::pair::{Kind, between, closest, is_tilted, perpendicular, sum_of_sides};
use crate::kernels::plane::clearance;
use crate::simd::{Bits, Loop, MAX_LANES, Registers, Vector};
use approach::BUNCH;
use group::{Block, Group, Weights};
use portions::Portion;
use voronoi::{Around, ON_SIDE, run_alongside};

/// A pair acts if it comes closer than its thickness plus this multiple of it. Other near pairs are held by truncation
/// only.
pub(crate) const ACTING: f32 = 0.3;
/// The numbers of the lanes.
const LANE: [f32; MAX_LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// The closest points of pairs: which of the pairs are near, and the data of their contact.
struct Proximity<L: Registers> {
    near: L::Mask,
    weights: [L; 4],
    distance: L,
    /// What is left of the distance if both sides move as they are about to, and below which the pair is near.
    left: L,
    reach: L,
    normal: Vector<L>,
    x: [Vector<L>; 4],
}

/// Finds the closest points of the pairs with the given corners. The positions' w is how far (m) vertices are about to
/// move relative to the common motion, and the displacements' how much farther contact may move them.
#[inline(always)]
fn proximity_of<L: Registers>(
    kind: Kind,
    [x, u]: [&[Vec4]; 2],
    corners: &[[u32; 4]],
    [thickness, full]: [L; 2],
    most_push: L,
    is_pair: L::Mask,
) -> Proximity<L> {
    let (one, half) = (L::splat(1.0), L::splat(0.5));
    let (x, travel) = whole_corners_of::<L>(x, corners);
    let weights = closest(kind, x);
    let apart = between(weights, x);
    let distance = apart.dot(apart).sqrt();
    let left = distance - sum_of_sides(kind, travel) - most_push;
    // The full thickness is more than contact lets any vertices move.
    let is_thin = L::bits(thickness.lt(full)) != 0;
    let reach = if is_thin { reach(kind, thickness, whole_corners_of::<L>(u, corners).1) } else { thickness };
    // A vector of no length has no direction.
    let near = L::and(is_pair, L::and(left.lt(reach), L::splat(1e-12).lt(distance)));
    let mut normal = apart * (one / distance);
    let is_tilted = is_tilted(distance, thickness, x, kind);
    if L::bits(L::and(is_tilted, near)) != 0 {
        let exact = perpendicular(apart, weights, x, kind);
        let length = exact.dot(exact).sqrt();
        // A vector that all but vanishes is noise.
        let is_exact = L::and(is_tilted, (distance * half).lt(length));
        normal = Vector::select(is_exact, Vector::new(exact.x / length, exact.y / length, exact.z / length), normal);
    }
    Proximity { near, weights, distance, left, reach, normal: Vector::select(near, normal, Vector::zero()), x }
}

impl<L: Registers> Proximity<L> {
    /// Notes what truncation needs of the pairs, in the lanes of a block from `first` on.
    #[inline(always)]
    fn note(&self, kind: Kind, thickness: L, block: &mut Block, first: usize) {
        let Proximity { weights, distance, normal, x, .. } = *self;
        let (zero, one, none) = (L::splat(0.0), L::splat(1.0), Vector::<L>::zero());
        // A point halfway between the closest points.
        let on_first = match kind {
            Kind::VertexTriangle => x[0],
            Kind::EdgeEdge => between([weights[0], weights[1], zero, zero], [x[0], x[1], none, none]),
        };
        let middle = on_first - normal * (distance * L::splat(0.5));
        for (k, (x, heights)) in x.into_iter().zip(&mut block.heights).enumerate() {
            let side = if k < kind.first_side() { one } else { L::splat(-1.0) };
            store(&mut heights[first..first + L::LANES], side * normal.dot(x - middle));
        }
        store(&mut block.clearance[first..first + L::LANES], clearance(distance, thickness));
        store_vector(&mut block.normal, first, normal);
        block.near |= L::bits(self.near) << first;
    }

    /// Which of the near pairs act, given the displacements (m) of vertices, and the two weights that determine all: see
    /// [`Kind::weights`]. Of pairs of edges in groups, the [`opposite`](Around::opposite) vertices are known.
    #[inline(always)]
    fn acting(
        &self,
        kind: Kind,
        u: &[Vec4],
        corners: &[[u32; 4]],
        opposite: Option<&[[u32; 4]]>,
        thickness: L,
        around: Around<'_>,
    ) -> (L::Mask, [L; 2]) {
        let Proximity { weights, distance, normal, .. } = *self;
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let gap = distance - thickness + normal.dot(between(weights, corners_of::<L>(u, corners)));
        let acts = L::and(self.near, gap.lt(thickness * L::splat(ACTING)));
        match kind {
            Kind::VertexTriangle => {
                let [_, a, b, c] = weights.map(|weight| L::splat(-ON_SIDE).lt(weight));
                let on_side = L::bits(L::and(acts, L::or(a, L::or(b, c))));
                let beside = if on_side == 0 { zero } else { around.beside(on_side, corners, weights) };
                (L::and(acts, L::eq(beside, zero)), [weights[2], weights[3]])
            }
            // If the closest point is an end of an edge, a vertex-triangle pair acts there instead.
            Kind::EdgeEdge => {
                let (s, t) = (weights[1], weights[3]);
                let inner = L::and(L::and(zero.lt(s), s.lt(one)), L::and(t.lt(zero), L::splat(-1.0).lt(t)));
                let acts = L::and(acts, inner);
                let tested = L::and(acts, run_alongside(self.x));
                let lanes = L::bits(tested);
                if lanes == 0 {
                    return (acts, [s, t]);
                }
                let mut found = [[0; 4]; MAX_LANES];
                if opposite.is_none() {
                    for lane in Bits(lanes.into()) {
                        found[lane] = around.opposite(corners[lane]);
                    }
                }
                let beside = L::select(tested, around.edges_beside(opposite.unwrap_or(&found), self.x, normal), zero);
                (L::and(acts, L::eq(beside, zero)), [s, t])
            }
        }
    }
}

/// Finds the near pairs among those of a portion that have not acted since they were listed and are due.
pub(crate) struct Find<'a> {
    /// Positions and displacements (m) of the vertices of listed pairs; the w of a position is how far (m) the vertex is about to
    /// move relative to the common motion.
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    pub most_push: f32,
    pub around: Around<'a>,
    pub portion: &'a mut Portion,
}

impl Loop for Find<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Find { x, u, most_push, around, portion } = self;
        let Portion { kind, corners, thickness, safe_until, blocks, joining, due_pairs, bunches, .. } = portion;
        let (kind, most_push, full) = (*kind, L::splat(2.0 * most_push), L::splat(around.surface.thickness));
        blocks.clear();
        joining.clear();
        due_pairs.select::<L>(safe_until, &bunches.approach);
        due_pairs.take::<L>(corners, thickness);
        let all = due_pairs.corners.chunks_exact(L::LANES).zip(due_pairs.thickness.chunks_exact(L::LANES));
        let mut first = MAX_LANES;
        for (places, (corners, thickness)) in due_pairs.places.chunks(L::LANES).zip(all) {
            let thickness = L::from_slice(thickness);
            let is_pair = number::<L>(&LANE, 0).lt(L::splat(places.len() as f32));
            let proximity = proximity_of(kind, [x, u], corners, [thickness, full], most_push, is_pair);
            let far = L::bits(L::and(is_pair, proximity.reach.lt(proximity.left)));
            if far != 0 {
                let mut at = [0.0; MAX_LANES];
                store(&mut at, proximity.distance - proximity.reach);
                for lane in Bits(far.into()) {
                    let place = usize::from(places[lane]);
                    safe_until[place] = bunches.approach[place / BUNCH].total + at[lane];
                }
            }
            let near = L::bits(proximity.near);
            if near == 0 {
                continue;
            }
            let acts = L::bits(proximity.acting(kind, u, corners, None, thickness, around).0);
            if near != acts {
                if first == MAX_LANES {
                    blocks.push(Block::default());
                    first = 0;
                }
                let last = blocks.len() - 1;
                let block = &mut blocks[last];
                block.corners[first..first + L::LANES].copy_from_slice(corners);
                proximity.note(kind, thickness, block, first);
                block.near &= !(acts << first);
                first += L::LANES;
            }
            for lane in Bits(acts.into()) {
                joining.push(places[lane]);
            }
        }
    }
}

/// Finds the closest points of the pairs that have acted since they were listed. Those that do not act now lose their
/// multipliers.
pub(crate) struct FindAgain<'a> {
    pub kind: Kind,
    pub groups: &'a mut [Group],
    /// The weights of their corners, none if a pair does not act.
    pub weights: &'a mut [Weights],
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    pub most_push: f32,
    pub around: Around<'a>,
}

impl Loop for FindAgain<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let FindAgain { kind, groups, weights, x, u, most_push, around } = self;
        let (zero, most_push, full) = (L::splat(0.0), L::splat(2.0 * most_push), L::splat(around.surface.thickness));
        for (group, to) in groups.iter_mut().zip(weights) {
            group.block.near = 0;
            for first in (0..MAX_LANES).step_by(L::LANES) {
                let lanes = first..first + L::LANES;
                let is_pair = number::<L>(&LANE, first).lt(L::splat(group.count as f32));
                let thickness = number::<L>(&group.thickness, first);
                let corners = &group.block.corners[lanes.clone()];
                let proximity = proximity_of(kind, [x, u], corners, [thickness, full], most_push, is_pair);
                let opposite = Some(&group.opposite[lanes.clone()]);
                let (acts, [free, last]) = proximity.acting(kind, u, corners, opposite, thickness, around);
                proximity.note(kind, thickness, &mut group.block, first);
                let weights = kind.weights(free, last);
                for (to, weights) in to.0.iter_mut().zip(weights) {
                    store(&mut to[lanes.clone()], L::select(acts, weights, zero));
                }
                store(&mut group.distance[lanes.clone()], L::select(acts, proximity.distance, thickness));
                let lambda_t = Vector::<L>::select(acts, vector(&group.lambda_t, first), Vector::zero());
                store_vector(&mut group.lambda_t, first, lambda_t);
                let lambda_n = L::select(acts, number(&group.lambda_n, first), zero);
                store(&mut group.lambda_n[lanes], lambda_n);
            }
        }
    }
}
