//! Cloth that is carried by what runs over it.
//!
//! Kinematic vertices cannot be truncated. A truncated cloth vertex moves with the common motion, which is that of none of them
//! if pins and bodies move differently, so a fast body would pass it. Therefore the cloth vertices of a pair whose plane a
//! kinematic vertex has shifted past them take over that vertex's displacement ("carried"), and truncation is repeated. A body
//! thus carries layer after layer, however far it moves. Cloth between two kinematic sides cannot be carried: it is pinched
//! ([`pinches`](super::pinches)). Around what crosses nothing is carried, because crossing parts would not separate.

use std::ops::Range;

use glam::{DVec3, Vec3A};

use super::Contacts;
use super::pinches::{distance, moves_through};
use crate::contact::input::ContactInput;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{Kind, between, closest};
use crate::kernels::plane::CLEARANCE;
use crate::simd::Vector;

/// How many times in a substep more vertices may be carried.
pub(crate) const ROUNDS: usize = 8;
/// A pair is run over, too, if its distance shrinks to less than this share of it, and to less than truncation keeps: it
/// would soon be so close that rounding decides on which side it is.
pub(crate) const CLOSER: f32 = 0.5;
/// A pair is also run over if its distance shrinks at all, and to less than this share of the thickness. What approaches slowly leaves
/// more than half of the distance in each substep, until it is so close ([`COINCIDENT`](super::pinches::COINCIDENT)) that it goes
/// through unnoticed.
pub(crate) const CLOSEST: f32 = 0.004;

/// A pair of which one side runs over the other one, which is to be carried.
struct RunOver {
    /// The kinematic vertex that moves farthest towards the other side, as a place among the vertices of listed pairs.
    leader: u32,
    followers: Vec<u32>,
}

impl Contacts {
    /// Carries vertices with what runs over them, after truncation has removed `lost` of the momentum (kg m). Returns what is lost in
    /// all. Near pairs were not found for vertices that move farther than [`ContactInput::max_carry`] besides the common motion; if
    /// there are such, carries nothing, and returns how far (m) they must be carried as an error. The displacements are not to be
    /// used then, but the multipliers are those of this substep.
    pub(crate) fn carry(&mut self, input: ContactInput<'_>, mut lost: DVec3) -> Result<DVec3, f32> {
        for round in 0..ROUNDS {
            let pairs = self.run_over(input);
            let travel = pairs.iter().map(|pair| self.vertices[pair.leader as usize].travel).fold(0.0, f32::max);
            if round == 0 && travel > input.max_carry {
                return Err(travel);
            }
            if pairs.is_empty() {
                break;
            }
            for RunOver { leader, followers } in pairs {
                for place in followers {
                    if !self.is_kinematic(place) {
                        self.u[place as usize] = self.u[leader as usize];
                        self.vertices[place as usize].push = Vec3A::ZERO;
                        self.relative[place as usize].w = 1.0;
                        self.carried.push(place);
                    }
                }
            }
            lost += self.truncate(input);
        }
        Ok(lost)
    }

    /// The pairs that are run over, among those whose plane has passed a vertex, where nothing crosses.
    fn run_over(&self, ContactInput { surface, entangled, .. }: ContactInput<'_>) -> Vec<RunOver> {
        let thickness = surface.thickness;
        let is_entangled = |place: u32| entangled.binary_search(&self.vertices[place as usize].index).is_ok();
        let is_run_over = |&(kind, places): &(Kind, [u32; 4])| {
            if !entangled.is_empty() && places.into_iter().any(is_entangled) {
                return false;
            }
            let (from, to) = (places.map(|place| self.start(place)), places.map(|place| self.end(place)));
            let (before, after) = (distance(kind, from), distance(kind, to));
            let is_close = after < CLEARANCE * thickness && after < CLOSER * before;
            let is_closest = after < CLOSEST * thickness && after < before;
            is_close || is_closest || moves_through(kind, from, to, thickness) == Some(true)
        };
        self.passed().filter(is_run_over).filter_map(|(kind, places)| self.follow(kind, places)).collect()
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
