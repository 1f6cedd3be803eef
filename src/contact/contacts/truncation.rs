//! Guarantees that the two sides of a near pair stay on either side of the plane halfway between them, whatever moves
//! them.
//!
//! Each near pair gets the plane halfway between its closest points, or [another](crate::kernels::plane) that shortens less, or one
//! near a kinematic side, which lets through what falls on it. A
//! vertex's displacement relative to the common motion is scaled by the largest factor in [0, 1] that keeps the vertex on its side
//! of the planes of all its pairs. The common motion is rigid, so it need not be scaled. (Lan et al. 2022 truncate along the path;
//! with one factor per vertex, no order of pairs is needed.)
//!
//! A plane that moves along with a pair serves as well, as long as no corner of it is shortened: otherwise cloth that swings or
//! spins by a third of a cell in a substep would be slowed down by its own neighbors. So a pair is [clear](Shares) if it stays
//! apart where its corners go, and its plane holds only pairs that are not, and then those of which a corner was shortened, until
//! there are no more. Pairs that are not near need no plane: truncation lets no vertex move farther than it was about to before the
//! response, apart from an [allowance](crate::contact::surface::Surface::allowance). The momentum that truncation removes is
//! returned to the cloth as a whole where [possible](crate::contact::returns_momentum), else crumpled cloth would drive itself, and
//! hover.
//!
//! One factor shortens a displacement along the plane, too, so cloth that is pressed against a mesh body would stick to it whatever
//! the friction, and cloth that pins gather would be left behind by them, drawn out to several times its length. Therefore a
//! displacement first loses what leads it beyond the planes of pairs with a kinematic side: it slides.
//! Pairs of cloth are not treated like that, because crumpled cloth would drive itself.
//!
//! The displacement of a kinematic vertex cannot be shortened, so a plane moves with it. Where it passes a vertex,
//! this vertex may have to be carried ([`carry`](super::carry)), or cloth is pinched ([`pinches`](super::pinches)).

use glam::{DVec3, Vec4};

use super::{Contacts, GRAIN};
use crate::contact::contacts::near::portions::{Portion, Truncation};
use crate::contact::input::ContactInput;
use crate::contact::surface::lanes::{corners_of, number, scattered, store, vector, whole_corners_of};
use crate::kernels::integrate::xyz;
use crate::kernels::plane::{Plane, excess};
use crate::simd::{self, Bits, Loop, MAX_LANES, Registers};

/// Rounds in which the pairs are held that a shortened corner no longer leaves clear. In the last one all are. (On the GPU there
/// are two, of which the last is needed only if the one before has shortened others.)
const HOLDING_ROUNDS: usize = 4;

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
        self.begin_shares(input);
        for round in 0..=HOLDING_ROUNDS {
            let has_held = self.shorten(input, round);
            if !has_held || self.shares.iter().all(|&share| share == 1.0) {
                break;
            }
        }
    }

    /// Computes how far vertices move relative to the common motion, and the share that is no more than contact may move them.
    fn begin_shares(&mut self, input: ContactInput<'_>) {
        let Contacts { vertices, u, relative, shares, carried, common_motion, .. } = self;
        let workers = input.context.workers;
        let part = workers.part(vertices.len(), GRAIN);
        shares.resize(vertices.len(), 1.0);
        let parts = vertices.chunks(part).zip(relative.chunks_mut(part)).zip(u.chunks(part)).zip(shares.chunks_mut(part));
        workers.each(parts, |(((vertices, relative), u), shares)| {
            for (((vertex, relative), &u), share) in vertices.iter().zip(relative).zip(u).zip(shares) {
                let way = xyz(u) + vertex.push - common_motion.at(xyz(vertex.x));
                let (length, most) = (way.length(), vertex.travel + vertex.allowance);
                *share = if length > most && vertex.x.w > 0.0 { most / length } else { 1.0 };
                *relative = common_motion.back(way).extend(if vertex.x.w > 0.0 { 0.0 } else { 1.0 });
            }
        });
        for place in carried.iter().map(|&place| place as usize) {
            (relative[place].w, shares[place]) = (1.0, 1.0);
        }
    }

    /// Shortens displacements by the planes of pairs: in the first round of those that are not clear, in later ones of those that
    /// were and have a corner that is shortened by now, and in the last of all others. Returns false if there are none.
    fn shorten(&mut self, input: ContactInput<'_>, round: usize) -> bool {
        let Contacts { portions, used, x, relative, shares, .. } = self;
        let (workers, width) = (input.context.workers, input.context.width);
        let thickness = input.surface.thickness;
        let (x, relative, portions): (&[Vec4], &[Vec4], _) = (x, relative, &mut portions[..*used]);
        let (is_first, so_far) = (round == 0, &*shares);
        workers.each(Portion::shared(portions, workers), |parts| {
            for portion in parts.into_iter().flatten() {
                let mut found = std::mem::take(&mut portion.truncation);
                if is_first {
                    found.begin(portion.blocks().count());
                    portion.near = portion.blocks().map(|block| block.near.count_ones()).sum();
                    portion.pressing = portion.groups.iter().map(|group| group.pressing() as u32).sum();
                } else {
                    found.hold_more(portion.blocks(), |corner| round == HOLDING_ROUNDS || so_far[corner as usize] < 1.0);
                }
                if is_first || found.holds() {
                    simd::run(width, Shares { portion, x, relative, thickness, is_first, found: &mut found });
                }
                portion.truncation = found;
            }
        });
        for &(vertex, share) in portions.iter().flat_map(|portion| &portion.truncation.shares) {
            let least = &mut shares[vertex as usize];
            *least = least.min(share);
        }
        is_first || portions.iter().any(|portion| portion.truncation.holds())
    }
}

/// Computes the share of its displacement relative to the common motion that each vertex of near pairs may take. A pair without
/// kinematic corners is clear if a plane that moves along with it [stays between](Plane::stays_between) its sides.
struct Shares<'a> {
    portion: &'a Portion,
    x: &'a [Vec4],
    relative: &'a [Vec4],
    thickness: f32,
    /// Whether all near pairs are to be tested, or those that are held now.
    is_first: bool,
    found: &'a mut Truncation,
}

impl Loop for Shares<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Shares { portion, x, relative, thickness, is_first, found } = self;
        let kind = portion.kind;
        let (zero, one, thickness) = (L::splat(0.0), L::splat(1.0), L::splat(thickness));
        let rows = |(index, block)| (0..MAX_LANES).step_by(L::LANES).map(move |first| (index, block, first));
        for (index, block, first) in portion.blocks().enumerate().flat_map(rows) {
            let tested = if is_first { block.near } else { found.held[index] };
            let mut near = tested >> first & ((1_u32 << L::LANES) - 1);
            if near == 0 {
                continue;
            }
            let places = &block.corners[first..first + L::LANES];
            let (relative, is_kinematic) = whole_corners_of::<L>(relative, places);
            let [a, b, c, d] = &block.heights;
            let heights = [number(a, first), number(b, first), number(c, first), number(d, first)];
            let (normal, clearance) = (vector::<L>(&block.normal, first), number::<L>(&block.clearance, first));
            let plane = Plane { normal, heights, clearance };
            let mut held = plane.hold(relative, is_kinematic, thickness, kind);
            let kinematic_corners = (is_kinematic[0] + is_kinematic[1]) + (is_kinematic[2] + is_kinematic[3]);
            if is_first {
                let is_free = L::eq(kinematic_corners, zero);
                let clear = L::bits(L::and(is_free, plane.stays_between(held.towards, kind))) & near;
                found.clear[index] |= clear << first;
                near &= !clear;
            }
            if near & (L::bits(held.least_share().lt(one)) | L::bits(zero.lt(held.passed_by))) == 0 {
                continue;
            }
            held = plane.least_shortening(held, corners_of::<L>(x, places), (relative, is_kinematic), thickness, kind);
            let Plane { normal, heights, clearance } = held.plane;
            let has_kinematic = L::bits(zero.lt(kinematic_corners));
            for (k, share) in held.shares.into_iter().enumerate() {
                let lanes = L::bits(share.lt(one)) & near;
                if lanes != 0 {
                    let (mut shares, mut beyond, mut squares) = ([0.0; MAX_LANES], [Vec4::ZERO; MAX_LANES], [0.0; MAX_LANES]);
                    store(&mut shares, share);
                    if has_kinematic != 0 {
                        let by = (held.towards[k] - (heights[k] - clearance).max(zero)).min(thickness);
                        scattered(normal * (if k < kind.first_side() { zero - by } else { by }), &mut beyond);
                        store(&mut squares, by * by);
                    }
                    for lane in Bits(lanes.into()) {
                        found.shares.push((places[lane][k], shares[lane]));
                        if has_kinematic >> lane & 1 != 0 {
                            found.beyond.push((places[lane][k], beyond[lane].with_w(squares[lane])));
                        }
                    }
                }
            }
            for lane in Bits((L::bits(zero.lt(held.passed_by)) & near).into()) {
                found.passed.push(places[lane]);
            }
        }
        // Which block a pair is in depends on what happened before, and so must not what a snapshot goes on with: sums of floats depend
        // on their order.
        found.beyond.sort_unstable_by_key(|(place, by)| (*place, by.to_array().map(f32::to_bits)));
        found.passed.sort_unstable();
    }
}
