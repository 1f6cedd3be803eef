//! Contact of cloth with itself (within a piece and between pieces) and with bodies that are triangle meshes.
//!
//! # Theory
//! The method keeps the cloth free of intersections instead of resolving them afterwards. [`detection`] lists the pairs
//! of features of the [`surface`] that may come closer than the thickness within some substeps, by a
//! [`tree`](detection::tree), a [broad phase](detection::broad_phase) and a [narrow phase](detection::narrow_phase). The
//! [`contacts`] of a substep are those of them that may do so in that substep ([`near`](contacts::near)), except for a vertex and
//! a triangle beside which it is above another one ([`voronoi`](contacts::near::voronoi)). The
//! [`response`](contacts::response) holds them apart by the thickness, with friction, and
//! [`truncation`](contacts::truncation) then shortens displacements so that the two sides of a pair stay on their sides of a plane,
//! whatever the response achieved.
//!
//! Detection assumes that vertices move along straight [`paths`](detection::paths), and is repeated when they leave them
//! by more than a margin. Kinematic vertices (of pins and mesh bodies) cannot be truncated, so they carry the cloth that
//! they would run over ([`carry`](contacts::carry)). Where they leave it no room, it is pinched, and may cross
//! ([`pinches`](contacts::pinches)). [`crossings`] finds what intersects; contact ignores the pairs that do
//! ([`ignored`](crossings::ignored)) until the cloth has left the intersection, or [`untangle`] has parted it.
//!
//! # Practice
//! [`TriangleContact::resolve`] runs in each substep, after the sweeps and before positions are updated. It loops over
//! vertices, pairs and leaves. Each item writes only its own data and gathers the contributions of others in a fixed
//! order, so the result does not depend on the number of threads.

mod bodies;
mod common_motion;
#[cfg(all(test, feature = "gpu"))]
#[path = "../../tests/unit/contact_constants.rs"]
pub(crate) mod constants;
mod contacts;
pub(crate) mod crossings;
mod detection;
#[cfg(feature = "gpu")]
pub(crate) mod device;
mod input;
mod past;
mod ranges;
mod surface;
pub(crate) mod untangle;
mod vertices;
mod workers;

use std::sync::Arc;
use std::sync::atomic::AtomicU32;

use glam::{DVec3, Vec3A, Vec4};

use crate::kernels::integrate::xyz;
use crate::kernels::params::Substep;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::{Contact, Crossing};
use crate::simd::{self, Width};
use crate::step::plan::Plan;

use bodies::Bodies;
use common_motion::CommonMotion;
#[cfg(feature = "gpu")]
pub(crate) use contacts::carry::ROUNDS;
#[cfg(feature = "gpu")]
pub(crate) use contacts::response::ITERATIONS;
use contacts::{Contacts, HoldOutcome};
use crossings::ignored::IgnoredPairs;
use detection::Detection;
#[cfg(feature = "gpu")]
pub(crate) use detection::max_listed;
use detection::paths::Paths;
use detection::rows::Rows;
use detection::tree::Tree;
use input::{ContactInput, Path, SubstepContext};
use past::Checkpoint;
pub(crate) use past::ContactPast;
use surface::Surface;
use vertices::PushOut;
pub(crate) use workers::Workers;

/// Least number of vertices that are worth a part of a loop, and how many vertices and listed pairs are worth a thread.
const GRAIN: usize = 64;
const VERTICES: usize = 128;
const PAIRS: usize = 1024;

/// Corrections of positions (m) that colliders add without changing velocities, and the length of the longest.
#[derive(Debug, Default)]
struct Pushes {
    of: Vec<Vec4>,
    most: f32,
}

impl Pushes {
    /// The corrections of all vertices; none if no collider pushes.
    fn of_vertices(&self) -> &[Vec4] {
        if self.most > 0.0 { &self.of } else { &[] }
    }
}

/// Counts for the report of a step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    /// Pairs with a normal impulse in the last substep.
    pub contacts: u32,
    /// Number of detections.
    pub detections: u32,
    /// Pairs listed at the end of the step.
    pub listed: u32,
    /// Near pairs at the end of the step.
    pub near: u32,
    /// Pairs that are squeezed in the last substep: see [`SQUEEZED`](crate::kernels::pair::SQUEEZED).
    pub squeezed: u32,
}

/// The state of contact of a cloth with itself and with mesh bodies, kept between steps.
#[derive(Debug)]
pub(crate) struct TriangleContact {
    surface: Surface,
    /// The cloth's coefficient of friction with itself.
    friction: f32,
    /// Over the triangles of the cloth, and over those of the bodies.
    trees: [Tree; 2],
    bodies: Bodies,
    lists: [Rows; 2],
    detection: Detection,
    contacts: Contacts,
    paths: Paths,
    /// Known intersections. Others may be anywhere if `may_cross` is set; otherwise they arise only around known ones, or
    /// where cloth is pinched.
    ignored: IgnoredPairs,
    may_cross: bool,
    /// Vertices that contact has led off their paths in this step, around which there may be others, too.
    drifted: Vec<u32>,
    /// In this step, pins move, or mesh bodies move and there are pins. Kinematic vertices may be made to intersect.
    kinematics_moved: bool,
    push: Pushes,
    /// How far (m) vertices may be carried in this step, besides the common motion.
    max_carry: f32,
    /// The duration (s) of the substep that the multipliers belong to; 0 if there are none.
    h: f32,
    /// The number of pairs if there were too many; 0 otherwise.
    pub too_many: usize,
    pub tally: Tally,
    checkpoint: Checkpoint,
}

impl TriangleContact {
    /// Returns `None` if the cloth has no triangles with an area.
    pub(crate) fn new(cloth: &Cloth, contact: Option<Contact>, meshes: Vec<Arc<Mesh>>) -> Option<TriangleContact> {
        let (mut surface, leaves) = Surface::new(cloth, contact)?;
        let of_cloth = Tree::of_cloth(&surface, leaves);
        let first = surface.rest.len();
        let leaves = surface.add_bodies(&meshes);
        let bodies = Bodies::new(first, meshes);
        Some(TriangleContact {
            surface,
            friction: contact.unwrap_or_default().friction,
            trees: [of_cloth, Tree::of_bodies(leaves)],
            bodies,
            lists: Default::default(),
            detection: Detection::default(),
            contacts: Contacts::default(),
            paths: Paths::default(),
            ignored: IgnoredPairs::default(),
            may_cross: true,
            drifted: Vec::new(),
            kinematics_moved: false,
            push: Pushes::default(),
            max_carry: 0.0,
            h: 0.0,
            too_many: 0,
            tally: Tally::default(),
            checkpoint: Checkpoint::default(),
        })
    }

    /// Whether a step can go on with these bodies.
    pub(crate) fn is_of<'a>(&self, meshes: impl ExactSizeIterator<Item = &'a Arc<Mesh>> + Clone) -> bool {
        self.bodies.are(meshes)
    }

    /// Whether it can go on from a saved state.
    pub(crate) fn may_have(&self, past: &ContactPast) -> bool {
        self.bodies.are_numbered_for(past.numbered.iter())
    }

    /// The number of vertices, including those of bodies, that the state must hold.
    pub(crate) fn vertices(&self) -> usize {
        self.surface.rest.len()
    }

    /// Discards everything that depends on positions, because the state was replaced.
    pub(crate) fn forget(&mut self) {
        self.bodies.forget();
        self.may_cross = true;
        self.h = 0.0;
        self.paths.forget();
        self.lists.iter_mut().for_each(Rows::clear);
        self.contacts.forget();
    }

    /// Edges that pass through triangles of the cloth, as of the last detection, or have done so in this step; given by
    /// vertices.
    pub(crate) fn crossings(&self) -> impl Iterator<Item = Crossing> {
        self.ignored.own_crossings(&self.surface)
    }

    /// For each pair of an edge and a triangle that intersect, one on the cloth and one on a body: the index of the
    /// body.
    pub(crate) fn crossings_with_bodies(&self) -> impl Iterator<Item = usize> {
        self.ignored.with_bodies(&self.surface)
    }

    /// Prepares for a step.
    pub(crate) fn begin(&mut self, plan: &Plan<'_>, x: &mut [Vec4], u: &mut [Vec4]) {
        (self.tally, self.too_many, self.max_carry) = (Tally::default(), 0, 0.0);
        self.ignored.begin();
        self.drifted.clear();
        self.save();
        let jumped = self.bodies.begin(plan, self.friction);
        self.bodies.place(plan, self.surface.thickness, x, u);
        self.may_cross |= jumped;
        // Bodies that stand still are not tested for straying, so those that stop must not have paths that go on.
        if jumped || self.bodies.are_still && self.paths.move_from(self.bodies.first) {
            self.paths.forget();
        }
        self.kinematics_moved = !plan.pins.is_empty() || plan.cloth.has_pins() && !self.bodies.are_still;
    }

    /// Resolves contact in one substep, with colliders, bodies and the cloth itself. Changes the displacements `u` (m),
    /// and the positions `x` (m) by the corrections that are to add no velocity. Does nothing more once there are too many pairs.
    pub(crate) fn resolve(
        &mut self,
        plan: &Plan<'_>,
        substep: &Substep,
        x: &mut [Vec4],
        u: &mut [Vec4],
        workers: Workers<'_>,
        width: Width,
    ) {
        if self.too_many > 0 {
            return;
        }
        let context = SubstepContext { plan, substep, workers, width };
        self.bodies.advance(plan, substep, x, u);
        self.part_touches(x);
        self.push_out(context, x, u);
        // Vertices that jump this far out of a collider may jump over others.
        self.may_cross |= self.push.most > self.surface.thickness;
        let common_motion = self.bodies.common_motion(plan, x, u, self.surface.thickness);
        if !self.list(context, x, u, common_motion.is_none()) {
            return;
        }
        (self.tally.near, self.tally.contacts) = (0, 0);
        if self.tally.listed > 0 {
            self.hold_apart(context, x, u, common_motion);
        }
        // Otherwise those of all vertices were added with what holds pairs apart.
        if self.tally.near == 0 {
            let push = self.push.of_vertices();
            x.iter_mut().zip(push).for_each(|(x, push)| *x += push.truncate().extend(0.0));
        }
    }

    /// Moves apart what touches exactly, once after the state was replaced or a body has jumped.
    fn part_touches(&self, x: &mut [Vec4]) {
        if self.may_cross && self.paths.since.is_none() {
            let moved = IgnoredPairs::part_touches(&self.surface, x);
            moved.into_iter().for_each(|(vertex, at)| x[vertex as usize] = at);
        }
    }

    /// Lists pairs unless all vertices are still close to the paths that the list was made for. Returns false if that is
    /// impossible: see [`TriangleContact::detect`].
    fn list(&mut self, SubstepContext { workers, width, .. }: SubstepContext<'_>, x: &[Vec4], u: &[Vec4], floats: bool) -> bool {
        let path = Path { x, u, margin: &[], workers };
        let moving = if self.bodies.are_still { self.bodies.first } else { x.len() };
        let moving_path = Path { x: &x[..moving], u: &u[..moving], workers: workers.for_items(moving, VERTICES), ..path };
        if !self.paths.are_followed(moving_path, floats, width) && !self.detect(path, moving, floats, width) {
            return false;
        }
        self.paths.since = self.paths.since.map(|since| since + 1.0);
        self.tally.listed = self.lists.iter().map(|rows| rows.pairs.len() as u32).sum();
        true
    }

    /// Holds the listed pairs apart that come near. They move relative to `common_motion`; without one the cloth is free,
    /// and they move relative to its mean motion.
    fn hold_apart(&mut self, context: SubstepContext<'_>, x: &mut [Vec4], u: &mut [Vec4], common_motion: Option<CommonMotion>) {
        let SubstepContext { plan, workers, .. } = context;
        let workers = workers.for_items(self.tally.listed as usize, PAIRS);
        let mut scale = if self.h > 0.0 { (plan.params.h / self.h).powi(2) } else { 0.0 };
        self.h = plan.params.h;
        let push = self.push.of_vertices();
        let floats = common_motion.is_none();
        let mut input = ContactInput {
            x,
            u,
            push,
            most_push: self.push.most,
            common_motion: common_motion.unwrap_or_else(|| CommonMotion::of(mean(plan.cloth, u))),
            max_carry: self.max_carry,
            entangled: &self.ignored.entangled,
            may_slide: self.bodies.first < self.vertices(),
            surface: &self.surface,
            friction: &self.bodies.friction,
            context: SubstepContext { workers, ..context },
        };
        let lost = loop {
            match self.contacts.hold_apart(&mut self.lists, input, scale) {
                HoldOutcome::Done { lost } => break lost,
                // The next time, near pairs are found for cloth that is carried this far.
                // The multipliers that it starts with are of this substep already.
                HoldOutcome::NeedsCarry(travel) => (input.max_carry, scale) = (travel, 1.0),
            }
        };
        self.max_carry = input.max_carry;
        if self.contacts.has_near() {
            // Pairs that are not listed stay apart only as long as vertices move about as detection assumed.
            let cloth = ..self.bodies.first;
            let drift = self.paths.drift(Path { x: &x[cloth], u: &u[cloth], margin: &[], workers }, floats);
            self.drifted.extend(self.contacts.finish([x, u], push, drift, workers));
            if lost != DVec3::ZERO && returns_momentum(plan) {
                give_back(plan.cloth, lost, u, workers);
            }
            [self.tally.near, self.tally.contacts] = self.contacts.counts();
            self.ignore_pinched(x, u);
        }
    }

    /// Ends a step at positions `x` (m), which those of bodies reach by `u` (m): puts what belongs to its state in the lists, counts
    /// what is squeezed, and searches for what may cross.
    pub(crate) fn end(&mut self, x: &[Vec4], u: &[Vec4], workers: Workers<'_>) {
        if (self.may_cross || !self.drifted.is_empty()) && self.too_many == 0 {
            let first = self.bodies.first;
            let ends: Vec<Vec4> = x[..first].iter().copied().chain((first..x.len()).map(|i| x[i] + u[i].with_w(0.0))).collect();
            if ends.iter().all(|x| x.is_finite()) && self.may_cross_at(&ends) {
                self.ignored.find(&self.surface, &ends);
                self.may_cross = false;
                self.paths.end();
            }
        }
        // Without near pairs in the last substep, the contacts are those of another one.
        self.tally.squeezed = if self.tally.near > 0 { self.contacts.squeezed() as u32 } else { 0 };
        self.contacts.store_multipliers(&mut self.lists, workers);
    }

    /// Whether there may be unknown intersections with all vertices at the positions `x` (m).
    fn may_cross_at(&mut self, x: &[Vec4]) -> bool {
        let drifted = std::mem::take(&mut self.drifted);
        self.may_cross = self.may_cross || IgnoredPairs::cross_around(&self.surface, x, drifted);
        self.may_cross
    }

    /// Moves vertices out of the colliders, by displacements and by corrections that are not part of them.
    fn push_out(&mut self, SubstepContext { plan, substep, workers, width }: SubstepContext<'_>, x: &[Vec4], u: &mut [Vec4]) {
        let Pushes { of, most } = &mut self.push;
        let was_pushed = std::mem::take(most) > 0.0;
        if plan.bodies.is_empty() {
            of.clear();
            return;
        }
        let cloth = self.bodies.first;
        of.resize(x.len(), Vec4::ZERO);
        let (farthest, workers) = (AtomicU32::new(0), workers.for_items(cloth, VERTICES));
        let part = workers.part(cloth, GRAIN);
        let state = x[..cloth].chunks(part).zip(u[..cloth].chunks_mut(part));
        workers.each(state.zip(of[..cloth].chunks_mut(part)), |((x, u), push)| {
            if was_pushed {
                push.fill(Vec4::ZERO);
            }
            simd::run(width, PushOut { plan, substep, x, u, push, most: &farthest });
        });
        *most = f32::from_bits(farthest.into_inner()).sqrt();
    }
}

/// The mean displacement (m), weighted by mass.
fn mean(cloth: &Cloth, u: &[Vec4]) -> Vec3A {
    let (mut sum, mut total) = (Vec3A::ZERO, 0.0);
    for (&u, mass) in u.iter().zip(free_masses(cloth)) {
        sum += xyz(u) * mass;
        total += mass;
    }
    sum / total
}

/// The mass (kg) of each vertex; 0 if it is not free.
fn free_masses(cloth: &Cloth) -> impl Iterator<Item = f32> {
    cloth.mass.iter().zip(&cloth.rest).map(|(&mass, rest)| if rest.w > 0.0 { mass } else { 0.0 })
}

/// Whether momentum that truncation removes is returned to the cloth as a whole. Not if it has kinematic vertices, because it
/// must not move relative to them. Colliders stop it in the next substep if it touches them, but not those of its parts that
/// are elsewhere.
pub(crate) fn returns_momentum(plan: &Plan<'_>) -> bool {
    !plan.cloth.has_pins() && plan.meshes.is_empty() && (plan.bodies.is_empty() || plan.cloth.parts == 1)
}

/// Returns lost momentum (kg m) to the cloth by a uniform displacement.
fn give_back(cloth: &Cloth, lost: DVec3, u: &mut [Vec4], workers: Workers<'_>) {
    let mass: f64 = free_masses(cloth).map(f64::from).sum();
    let back = (lost / mass).as_vec3().extend(0.0);
    workers.chunks(&mut u[..cloth.rest.len()], GRAIN, |first, u| {
        u.iter_mut().zip(&cloth.rest[first..]).filter(|(_, rest)| rest.w > 0.0).for_each(|(u, _)| *u += back);
    });
}
