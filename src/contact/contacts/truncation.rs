//! Guarantees that the two sides of a near pair stay on either side of the plane halfway between them, whatever moves
//! them.
//!
//! Each near pair gets the plane halfway between its closest points. A vertex's displacement relative to the common motion is
//! scaled by the largest factor in [0, 1] that keeps the vertex on its side of the planes of all its pairs. The common motion is
//! rigid, so it need not be scaled. (Lan et al. 2022 truncate along the path; with one factor per vertex, no order of pairs is
//! needed.) Pairs that are not near need no plane: truncation lets no vertex move farther than it was about to before the
//! response, apart from an allowance ([`FARTHER`]). The momentum that truncation removes is returned to the cloth as a whole if
//! it has no kinematic vertices, else crumpled cloth would drive itself, and hover.
//!
//! One factor shortens a displacement along the plane, too, so cloth that is pressed against a mesh body would stick to it whatever
//! the friction. Therefore a displacement first loses what leads it beyond the planes of pairs with a kinematic side: it slides.
//! Pairs of cloth are not treated like that, because crumpled cloth would drive itself.
//!
//! The displacement of a kinematic vertex cannot be shortened, so a plane moves with it. Where it passes a vertex,
//! this vertex may have to be carried ([`carry`](super::carry)), or cloth is pinched ([`pinches`](super::pinches)).

use glam::{DVec3, Vec4};

use super::{Contacts, GRAIN};
use crate::contact::contacts::near::portions::{Portion, Truncation};
use crate::contact::input::ContactInput;
use crate::contact::surface::lanes::{number, scattered, store, vector, whole_corners_of};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{excess, share_above};
use crate::simd::{self, Loop, MAX_LANES, Registers};

/// How much farther contact may move a vertex than it was about to move, as a multiple of its
/// [`Vertex::half_gap`](crate::contact::input::Vertex::half_gap).
pub(crate) const FARTHER: f32 = 0.45;

impl Contacts {
    /// Shortens the displacements of vertices. Returns the momentum (kg m) that this removes from a cloth that nothing holds.
    pub(crate) fn truncate(&mut self, input: ContactInput<'_>) -> DVec3 {
        self.find_shares(input);
        if self.carried.is_empty() && self.slide() {
            self.find_shares(input);
        }
        let Contacts { vertices, u, shares, common_motion, .. } = self;
        let mass = &input.context.plan.cloth.mass;
        let mut lost = DVec3::ZERO;
        for (place, &share) in shares.iter().enumerate().filter(|(_, share)| **share < 1.0) {
            let (vertex, u) = (&mut vertices[place], &mut u[place]);
            let before = xyz(*u);
            let base = common_motion.at(xyz(vertex.x));
            let after = base + (before - base) * share;
            vertex.push *= share;
            lost += (before - after).as_dvec3() * f64::from(mass[vertex.index as usize]);
            *u = after.extend(0.0);
        }
        lost
    }

    /// Removes from the displacements of vertices what leads them beyond the planes of pairs with a kinematic side. Returns
    /// whether there are any such displacements.
    fn slide(&mut self) -> bool {
        let Contacts { portions, used, u, beyond, .. } = self;
        let mut found = portions[..*used].iter().flat_map(|portion| &portion.truncation.beyond).peekable();
        if found.peek().is_none() {
            return false;
        }
        beyond.clear();
        beyond.resize(u.len(), Vec4::ZERO);
        found.for_each(|&(place, by)| beyond[place as usize] += by);
        for (u, &sum) in u.iter_mut().zip(&*beyond).filter(|(_, sum)| sum.w > 0.0) {
            *u -= excess(xyz(sum), sum.w).extend(0.0);
        }
        true
    }

    /// Computes the share of each vertex's displacement that is left.
    fn find_shares(&mut self, input: ContactInput<'_>) {
        let Contacts { portions, used, vertices, u, relative, shares, carried, common_motion, .. } = self;
        let workers = input.context.workers;
        let part = workers.part(vertices.len(), GRAIN);
        shares.resize(vertices.len(), 1.0);
        let parts = vertices.chunks(part).zip(relative.chunks_mut(part)).zip(u.chunks(part)).zip(shares.chunks_mut(part));
        workers.each(parts, |(((vertices, relative), u), shares)| {
            for (((vertex, relative), &u), share) in vertices.iter().zip(relative).zip(u).zip(shares) {
                let way = xyz(u) + vertex.push - common_motion.at(xyz(vertex.x));
                let (length, most) = (way.length(), vertex.travel + FARTHER * vertex.half_gap);
                *share = if length > most && vertex.x.w > 0.0 { most / length } else { 1.0 };
                *relative = common_motion.back(way).extend(if vertex.x.w > 0.0 { 0.0 } else { 1.0 });
            }
        });
        for place in carried.iter().map(|&place| place as usize) {
            (relative[place].w, shares[place]) = (1.0, 1.0);
        }
        let (relative, portions): (&[Vec4], _) = (relative, &mut portions[..*used]);
        workers.each(Portion::shared(portions, workers), |parts| {
            for portion in parts.into_iter().flatten() {
                let mut found = std::mem::take(&mut portion.truncation);
                found.clear();
                simd::run(
                    input.context.width,
                    Shares {
                        portion,
                        relative,
                        may_slide: input.may_slide,
                        thickness: input.surface.thickness,
                        found: &mut found,
                    },
                );
                portion.truncation = found;
                portion.near = portion.blocks().map(|block| block.near.count_ones()).sum();
                portion.pressing = portion.groups.iter().map(|group| group.pressing() as u32).sum();
            }
        });
        for &(vertex, share) in portions.iter().flat_map(|portion| &portion.truncation.shares) {
            let least = &mut shares[vertex as usize];
            *least = least.min(share);
        }
    }
}

/// Computes the share of its displacement relative to the common motion that each vertex of near pairs may take.
struct Shares<'a> {
    portion: &'a Portion,
    relative: &'a [Vec4],
    may_slide: bool,
    thickness: f32,
    found: &'a mut Truncation,
}

impl Loop for Shares<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Shares { portion, relative, may_slide, thickness, found } = self;
        let kind = portion.kind;
        let (zero, one, thickness) = (L::splat(0.0), L::splat(1.0), L::splat(thickness));
        for (block, first) in portion.blocks().flat_map(|block| (0..MAX_LANES).step_by(L::LANES).map(move |first| (block, first)))
        {
            let near = block.near >> first & ((1_u32 << L::LANES) - 1);
            if near == 0 {
                continue;
            }
            let places = &block.corners[first..first + L::LANES];
            let (relative, is_kinematic) = whole_corners_of::<L>(relative, places);
            let (normal, clearance) = (vector::<L>(&block.normal, first), number::<L>(&block.clearance, first));
            let mut heights = [zero; 4];
            let mut towards = [zero; 4];
            let (mut shift_from_first, mut shift_from_second) = (zero, zero);
            for k in 0..4 {
                let is_first = k < kind.first_side();
                let side = if is_first { one } else { L::splat(-1.0) };
                heights[k] = number(&block.heights[k], first);
                towards[k] = (zero - side) * normal.dot(relative[k]);
                // Kinematic and carried corners are not truncated. As far as one of them would cross the plane, the plane
                // is shifted; if both sides push, by the difference.
                let out = (clearance - (heights[k] - towards[k])).max(zero) * is_kinematic[k];
                if is_first {
                    shift_from_first = shift_from_first.max(out);
                } else {
                    shift_from_second = shift_from_second.max(out);
                }
            }
            let shift = shift_from_second - shift_from_first;
            let kinematic_corners = (is_kinematic[0] + is_kinematic[1]) + (is_kinematic[2] + is_kinematic[3]);
            let has_kinematic = if may_slide { L::bits(zero.lt(kinematic_corners)) } else { 0 };
            // Two kinematic sides may also move into each other.
            let mut passed_by = (shift_from_second + shift_from_first - clearance - clearance).max(zero);
            for k in 0..4 {
                let along = if k < kind.first_side() { zero - shift } else { shift };
                let height = heights[k] + along;
                let share = L::select(zero.lt(is_kinematic[k]), one, share_above(height, clearance, towards[k]));
                passed_by = passed_by.max(L::select(zero.lt(is_kinematic[k]), zero, zero - height));
                let mut lanes = L::bits(share.lt(one)) & near;
                if lanes != 0 {
                    let (mut shares, mut beyond, mut squares) = ([0.0; MAX_LANES], [Vec4::ZERO; MAX_LANES], [0.0; MAX_LANES]);
                    store(&mut shares, share);
                    if has_kinematic != 0 {
                        let by = (towards[k] - (height - clearance).max(zero)).min(thickness);
                        scattered(normal * (if k < kind.first_side() { zero - by } else { by }), &mut beyond);
                        store(&mut squares, by * by);
                    }
                    while lanes != 0 {
                        let lane = lanes.trailing_zeros() as usize;
                        lanes &= lanes - 1;
                        found.shares.push((places[lane][k], shares[lane]));
                        if has_kinematic >> lane & 1 != 0 {
                            found.beyond.push((places[lane][k], beyond[lane].with_w(squares[lane])));
                        }
                    }
                }
            }
            let mut are_passed = L::bits(zero.lt(passed_by)) & near;
            while are_passed != 0 {
                found.passed.push(places[are_passed.trailing_zeros() as usize]);
                are_passed &= are_passed - 1;
            }
        }
    }
}
