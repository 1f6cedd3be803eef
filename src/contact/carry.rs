//! Cloth that is carried by what runs over it.
//!
//! Kinematic vertices cannot be truncated. A truncated cloth vertex moves with the common motion, which is that of none of them
//! if pins and bodies move differently, so a fast body would pass it. Therefore the cloth vertices of a pair whose plane a
//! kinematic vertex has shifted past them take over that vertex's displacement ("carried"), and truncation is repeated. A body
//! thus carries layer after layer, however far it moves. Cloth between two kinematic sides cannot be carried: it is pinched
//! ([`pinches`](super::pinches)). Around what crosses nothing is carried, because crossing parts would not separate.
//!
//! Colliders that are not meshes push vertices before pairs are held apart. Where truncation takes back so much of this that a
//! vertex sinks into a collider, the vertex is carried with the collider's surface. Not where there are pins or mesh bodies, which
//! nothing can stop either: they would come closer to what is carried in many small steps until they touch it. Pairs come first: if that makes a pair move
//! through each other, colliders carry nothing in this substep.

use std::ops::Range;

use glam::{DVec3, Vec3A, Vec4};

use super::contacts::{Contacts, Held};
use super::input::ContactInput;
use super::pairs::{Kind, between, closest};
use super::pinches::{distance, meets, moves_through};
use super::vertices::FindSinking;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::CLEARANCE;
use crate::kernels::params::Substep;
use crate::simd::{self, Vector};
use crate::step::plan::Plan;

/// How many times in a substep more vertices may be carried.
pub(crate) const ROUNDS: usize = 16;
/// A pair is run over, too, if its distance shrinks to less than this share of it, and to less than truncation keeps: it
/// would soon be so close that rounding decides on which side it is.
pub(super) const CLOSER: f32 = 0.5;

/// How deep truncation may leave a vertex in a collider, in units of the thickness, before the collider carries it.
pub(super) const SUNK: f32 = 0.1;
/// How much farther than they must be carried vertices may be, from then on in the step: the common motion differs a little from
/// substep to substep.
pub(crate) const AMPLE: f32 = 1.25;

/// Whether a pair goes through each other while its corners move from some positions (m) to others; then the thickness (m).
type GoesThrough = fn(Kind, [Vec3A; 4], [Vec3A; 4], f32) -> Option<bool>;

/// A pair of which one side runs over the other one, which is to be carried.
struct RunOver {
    /// The kinematic vertex that moves farthest towards the other side, as a place among the vertices of listed pairs.
    leader: u32,
    followers: Vec<u32>,
}

impl Contacts {
    /// Carries vertices with what runs over them, and with colliders that they sink into, after truncation has removed `lost` of the
    /// momentum (kg m). Near pairs were not found for vertices that move farther than [`ContactInput::max_carry`] besides the common
    /// motion; if there are such, carries nothing.
    pub(super) fn carry(&mut self, input: ContactInput<'_>, plan: &Plan<'_>, substep: &Substep, lost: DVec3) -> Held {
        if !plan.colliders_carry() || self.sinking(input, plan, substep).is_empty() {
            return self.carry_in_rounds(input, plan, substep, lost, false);
        }
        let before: Vec<(Vec4, Vec3A)> = self.u.iter().zip(&self.vertices).map(|(&u, vertex)| (u, vertex.push)).collect();
        let held = self.carry_in_rounds(input, plan, substep, lost, true);
        if matches!(held, Held::NeedsCarry(_)) || self.run_over(input, meets).next().is_none() {
            return held;
        }
        // What a collider carries runs over something that cannot get out of its way. It sinks in instead.
        for ((u, push), (now, vertex)) in before.into_iter().zip(self.u.iter_mut().zip(&mut self.vertices)) {
            (*now, vertex.push) = (u, push);
        }
        self.carried.clear();
        let lost = lost + self.truncate(&plan.cloth.mass, input);
        self.carry_in_rounds(input, plan, substep, lost, false)
    }

    /// Does so, as for the colliders only if they `may_carry`.
    fn carry_in_rounds(
        &mut self,
        input: ContactInput<'_>,
        plan: &Plan<'_>,
        substep: &Substep,
        mut lost: DVec3,
        may_carry: bool,
    ) -> Held {
        for round in 0..ROUNDS {
            let pairs: Vec<RunOver> =
                self.run_over(input, moves_through).filter_map(|(kind, places)| self.follow(kind, places)).collect();
            let travel = pairs.iter().map(|pair| self.vertices[pair.leader as usize].travel).fold(0.0, f32::max);
            if round == 0 && travel > input.max_carry {
                return Held::NeedsCarry(travel);
            }
            let sinking = if may_carry { self.sinking(input, plan, substep) } else { Vec::new() };
            let way = |&(place, u): &(u32, Vec4)| (xyz(u) - self.common_motion.at(self.start(place))).length();
            let farthest = sinking.iter().map(way).fold(0.0, f32::max);
            if farthest > input.max_carry {
                return Held::NeedsCarry(AMPLE * farthest);
            }
            if pairs.is_empty() && sinking.is_empty() {
                break;
            }
            sinking.into_iter().for_each(|(place, u)| self.carry_by(place, u));
            for RunOver { leader, followers } in pairs {
                followers.into_iter().for_each(|place| self.carry_by(place, self.u[leader as usize]));
            }
            lost += self.truncate(&plan.cloth.mass, input);
        }
        Held::Done { lost }
    }

    /// Carries a vertex by a displacement (m), unless it is kinematic or carried already.
    fn carry_by(&mut self, place: u32, u: Vec4) {
        if !self.is_kinematic(place) {
            self.u[place as usize] = u;
            self.vertices[place as usize].push = Vec3A::ZERO;
            self.relative[place as usize].w = 1.0;
            self.carried.push(place);
        }
    }

    /// The vertices that sink into a collider, where nothing crosses, and the displacements (m) of its surface there.
    fn sinking(&self, input: ContactInput<'_>, plan: &Plan<'_>, substep: &Substep) -> Vec<(u32, Vec4)> {
        let mut found = Vec::new();
        if !plan.bodies.is_empty() {
            let Contacts { vertices, x, u, shares, .. } = self;
            let depth = SUNK * input.thickness;
            simd::run(input.width, FindSinking { plan, substep, vertices, x, u, shares, depth, found: &mut found });
            found.retain(|&(place, _)| !self.is_kinematic(place) && !self.is_entangled(place, input));
        }
        found
    }

    /// Whether a vertex is around what crosses.
    fn is_entangled(&self, place: u32, ContactInput { entangled, .. }: ContactInput<'_>) -> bool {
        !entangled.is_empty() && entangled.binary_search(&self.vertices[place as usize].index).is_ok()
    }

    /// The pairs that are run over, among those whose plane has passed a vertex, where nothing crosses: [`moves_through`] tells
    /// whether they go through each other, or [`meets`], which counts what touched before, too.
    fn run_over(&self, input: ContactInput<'_>, goes_through: GoesThrough) -> impl Iterator<Item = (Kind, [u32; 4])> {
        let thickness = input.thickness;
        let is_run_over = move |&(kind, places): &(Kind, [u32; 4])| {
            if places.into_iter().any(|place| self.is_entangled(place, input)) {
                return false;
            }
            let (from, to) = (places.map(|place| self.start(place)), places.map(|place| self.end(place)));
            let after = distance(kind, to);
            let is_close = after < CLEARANCE * thickness && after < CLOSER * distance(kind, from);
            is_close || goes_through(kind, from, to, thickness) == Some(true)
        };
        self.passed().filter(is_run_over)
    }

    /// Which vertices of a pair are to be carried by which; `None` if all are kinematic.
    fn follow(&self, kind: Kind, places: [u32; 4]) -> Option<RunOver> {
        let corners = places.map(|place| self.start(place)).map(|x| Vector { x: x.x, y: x.y, z: x.z });
        let weights = closest(kind, corners);
        let apart = between(weights, corners);
        let towards_first = Vec3A::new(apart.x, apart.y, apart.z);
        let leader = |side: Range<usize>, towards: Vec3A| {
            let kinematic = places[side].iter().filter(|&&place| self.is_kinematic(place));
            let moves = kinematic.map(|&place| (towards.dot(xyz(self.u[place as usize])), place));
            moves.max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let followers = |side: Range<usize>| -> Vec<u32> {
            // A corner without a weight is not where the pair is closest.
            let near = side.filter(|&k| weights[k] != 0.0).map(|k| places[k]);
            near.filter(|&place| !self.is_kinematic(place)).collect()
        };
        let (first, second) = (0..kind.first_side(), kind.first_side()..4);
        let by_first = leader(first.clone(), -towards_first).map(|leader| (leader, followers(second.clone())));
        let by_second = leader(second, towards_first).map(|leader| (leader, followers(first)));
        let sides = [by_first, by_second].into_iter().flatten().filter(|(_, followers)| !followers.is_empty());
        let ((_, leader), followers) = sides.max_by(|(a, _), (b, _)| a.0.total_cmp(&b.0))?;
        Some(RunOver { leader, followers })
    }

    /// Whether a vertex is kinematic, or carried, as of the last truncation.
    fn is_kinematic(&self, place: u32) -> bool {
        self.relative[place as usize].w > 0.0
    }
}
