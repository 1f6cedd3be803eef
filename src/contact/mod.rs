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
//! ([`known`](crossings::known)) until the cloth has left the intersection, or [`untangle`] has parted it.
//!
//! # Stages of a substep
//! [`TriangleContact::resolve`] calls them in this order, after the sweeps and before positions are updated. The GPU's files are in
//! `shaders/stages/self_contact`, with the entry points named here; `src/gpu/contact/encode.rs` dispatches them.
//!
//! | Stage | In the field's terms | CPU | GPU |
//! |---|---|---|---|
//! | move bodies | kinematic vertices | `bodies.rs` | `begin_contact.wgsl` |
//! | push out | projection onto analytic colliders | `vertices.rs` | `begin_contact.wgsl`: `begin_contact` |
//! | test paths | validity of the neighbor lists | `detection/paths.rs` | `begin_contact.wgsl`: `begin_contact`, `decide` |
//! | look for crossings | edges against triangles; global intersection analysis | `crossings/` | on the CPU, before and after the step |
//! | list pairs | broad phase by bounding volume hierarchies (BVH), narrow phase | `listing.rs`, `detection/` | `tree.wgsl`, `descent.wgsl`: `descend`; `broad_phase.wgsl`: `compare`; `narrow_phase.wgsl`: `measure` |
//! | find near pairs | proximity of closest points | `contacts/near/` | `near.wgsl`: `find` |
//! | respond | multipliers with Coulomb's friction cone, Jacobi iteration | `contacts/response.rs` | `response.wgsl`: `warm_start`, `step_pairs`, `apply_impulses` |
//! | truncate | separating planes, in place of continuous collision detection (CCD) or the barrier of IPC | `contacts/truncation.rs` | `truncation.wgsl`: `truncate`; `finish.wgsl`: `finish` |
//! | carry | what kinematic vertices run over | `contacts/carry.rs` | `carry.wgsl`: `carry` |
//! | note what is pinched | continuous collision test of tetrahedra | `contacts/pinches.rs` | `carry.wgsl`: `find_pinched` |
//!
//! # Practice
//! Every stage loops over vertices, pairs or leaves. Each item writes only its own data and gathers the contributions of others in
//! a fixed order, so the result does not depend on the number of threads.

mod bodies;
mod common_motion;
#[cfg(all(test, feature = "gpu"))]
#[path = "../../tests/unit/contact_constants.rs"]
pub(crate) mod constants;
mod contacts;
pub(crate) mod crossings;
pub(crate) mod detection;
#[cfg(feature = "gpu")]
pub(crate) mod device;
mod input;
mod listing;
mod momentum;
mod past;
mod ranges;
pub(crate) mod surface;
pub(crate) mod untangle;
mod vertices;
mod workers;

use std::sync::Arc;

use glam::{DVec3, Vec3A, Vec4};

use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::Contact;
use crate::step::plan::{Listing, Plan};

use bodies::Bodies;
use common_motion::CommonMotion;
use contacts::Contacts;
#[cfg(feature = "gpu")]
pub(crate) use contacts::carry::ROUNDS;
#[cfg(feature = "gpu")]
pub(crate) use contacts::response::iterations;
use contacts::response::warm_scale;
use crossings::known::{KnownCrossings, Posed};
use detection::Detection;
#[cfg(feature = "gpu")]
pub(crate) use detection::max_listed;
use detection::paths::Paths;
use detection::rows::Rows;
use detection::tree::Tree;
pub(crate) use input::SubstepContext;
use input::{ContactInput, Path};
pub(crate) use momentum::returns_momentum;
pub(crate) use past::ContactPast;
use surface::Surface;
use vertices::Pushes;
pub(crate) use workers::Workers;

/// Least number of vertices that are worth a part of a loop, and how many vertices and listed pairs are worth a thread.
const VERTICES_OF_PART: usize = 64;
const VERTICES_OF_THREAD: usize = 128;
const PAIRS_OF_THREAD: usize = 1024;

/// See [`Path::floats`].
fn floats(plan: &Plan<'_>) -> bool {
    plan.meshes.is_empty() && !plan.cloth.has_pins()
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

/// The state of contact that another one replaced, if there was any.
pub(crate) struct Replaced<T>(pub Option<Box<T>>);

/// The state of contact of a cloth with itself and with mesh bodies, kept between steps.
pub(crate) struct TriangleContact {
    pub surface: Surface,
    /// The cloth's coefficient of friction with itself.
    friction: f32,
    /// Over the triangles of the cloth, and over those of the bodies.
    trees: [Tree; 2],
    pub bodies: Bodies,
    lists: [Rows; 2],
    detection: Detection,
    contacts: Contacts,
    paths: Paths,
    pub crossings: KnownCrossings,
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
    /// The state at the start of the step.
    checkpoint: ContactPast,
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
            crossings: KnownCrossings::default(),
            kinematics_moved: false,
            push: Pushes::default(),
            max_carry: 0.0,
            h: 0.0,
            too_many: 0,
            tally: Tally::default(),
            checkpoint: ContactPast::default(),
        })
    }

    /// The number of vertices, including those of bodies, that the state must hold.
    pub(crate) fn vertices(&self) -> usize {
        self.surface.rest.len()
    }

    /// Discards everything that depends on positions, because the state was replaced.
    pub(crate) fn forget(&mut self) {
        self.bodies.forget();
        self.crossings.are_all = false;
        self.h = 0.0;
        self.paths.forget();
        self.lists.iter_mut().for_each(Rows::clear);
        self.contacts.forget();
    }

    /// Prepares for a step.
    pub(crate) fn begin(&mut self, plan: &Plan<'_>, x: &mut [Vec4], u: &mut [Vec4]) {
        (self.tally, self.too_many, self.max_carry) = (Tally::default(), 0, 0.0);
        self.crossings.begin();
        self.save();
        let jumped = self.bodies.begin(plan, self.friction, self.surface.thickness);
        self.bodies.place(plan, self.surface.thickness, x, u);
        self.crossings.are_all &= !jumped;
        // Bodies that stand still are not tested for straying, so those that stop must not have paths that go on.
        if jumped || self.bodies.are_still && self.paths.move_from(self.bodies.first) {
            self.paths.forget();
        }
        self.kinematics_moved = !plan.pins.is_empty() || plan.cloth.has_pins() && !self.bodies.are_still;
    }

    /// Resolves contact in one substep, with colliders, bodies and the cloth itself. Changes the displacements `u` (m),
    /// and the positions `x` (m) by the corrections that are to add no velocity. Does nothing more once there are too many pairs.
    pub(crate) fn resolve(&mut self, context: SubstepContext<'_>, x: &mut [Vec4], u: &mut [Vec4]) {
        let SubstepContext { plan, substep, workers, .. } = context;
        if self.too_many > 0 {
            return;
        }
        self.bodies.advance(plan, substep, x, u);
        self.part_touches(x, workers);
        self.push.push_out(context, x, u, self.bodies.first);
        // Vertices that jump this far out of a collider may jump over others.
        self.crossings.are_all &= self.push.most <= self.surface.thickness;
        let common_motion = self.bodies.common_motion(plan, x, u, self.surface.thickness);
        let covers = plan.listing == Listing::EveryStop;
        let (by, margin) = if covers { self.ways(plan, x, u, common_motion) } else { Default::default() };
        let by = if covers { &by } else { &*u };
        if !self.list(context, Path { x, u: by, margin: &margin, floats: floats(plan), workers }) {
            return;
        }
        (self.tally.near, self.tally.contacts) = (0, 0);
        if self.tally.listed == 0 || !self.hold_apart(context, x, u, common_motion) {
            let push = self.push.of_vertices();
            x.iter_mut().zip(push).for_each(|(x, push)| *x += push.truncate().extend(0.0));
        }
    }

    /// Moves apart what touches exactly, once after the state was replaced or a body has jumped.
    fn part_touches(&self, x: &mut [Vec4], workers: Workers<'_>) {
        if !self.crossings.are_all && self.paths.since.is_none() {
            let posed = Posed { surface: &self.surface, x, is_shared: workers.count() > 1 };
            let moved = KnownCrossings::part_touches(posed);
            moved.into_iter().for_each(|(vertex, at)| x[vertex as usize] = at);
        }
    }

    /// Lists pairs unless all vertices are still close to the paths that the list was made for. Returns false if that is
    /// impossible: see [`TriangleContact::detect`].
    fn list(&mut self, SubstepContext { workers, width, .. }: SubstepContext<'_>, path: Path<'_>) -> bool {
        let moving = if self.bodies.are_still { self.bodies.first } else { path.x.len() };
        let workers = workers.for_items(moving, VERTICES_OF_THREAD);
        let moving_path = Path { x: &path.x[..moving], u: &path.u[..moving], workers, ..path };
        if !self.paths.are_followed(moving_path, width) && !self.detect(path, moving, width) {
            return false;
        }
        self.paths.since = self.paths.since.map(|since| since + 1.0);
        self.tally.listed = self.lists.iter().map(|rows| rows.pairs.len() as u32).sum();
        true
    }

    /// Paths that cover all places at which contact may stop the vertices in this substep: the common motion, and how far (m) each
    /// vertex is about to get from it. What is kinematic does not leave its own.
    fn ways(&self, plan: &Plan<'_>, x: &[Vec4], u: &[Vec4], common_motion: Option<CommonMotion>) -> (Vec<Vec4>, Vec<f32>) {
        let common_motion = common_motion.unwrap_or_else(|| CommonMotion::of(momentum::mean(plan.cloth, u)));
        let push = self.push.of_vertices();
        let way = |(vertex, (x, u)): (usize, (&Vec4, &Vec4))| {
            if x.w == 0.0 {
                return (*u, 0.0);
            }
            let by = common_motion.at(xyz(*x));
            let push = push.get(vertex).map_or(Vec3A::ZERO, |&push| xyz(push));
            (by.extend(0.0), (xyz(*u) + push - by).length() + self.surface.allowance[vertex])
        };
        x.iter().zip(u).enumerate().map(way).unzip()
    }

    /// Holds the listed pairs apart that come near, and pushes all vertices out of colliders. Returns false, and does neither, if none
    /// come near. They move relative to `common_motion`; without one nothing holds the cloth, and they move relative to its mean motion.
    fn hold_apart(
        &mut self,
        context: SubstepContext<'_>,
        x: &mut [Vec4],
        u: &mut [Vec4],
        common_motion: Option<CommonMotion>,
    ) -> bool {
        let SubstepContext { plan, workers, .. } = context;
        let workers = workers.for_items(self.tally.listed as usize, PAIRS_OF_THREAD);
        let mut scale = warm_scale(plan.params.h, self.h);
        self.h = plan.params.h;
        let push = self.push.of_vertices();
        let mut input = ContactInput {
            x,
            u,
            push,
            most_push: self.push.most,
            free: &self.push.free,
            common_motion: common_motion.unwrap_or_else(|| CommonMotion::of(momentum::mean(plan.cloth, u))),
            max_carry: self.max_carry,
            entangled: &self.crossings.entangled,
            surface: &self.surface,
            friction: &self.bodies.friction,
            context: SubstepContext { workers, ..context },
        };
        let lost = loop {
            self.contacts.find_near(&mut self.lists, input);
            if !self.contacts.has_near() {
                break DVec3::ZERO;
            }
            self.contacts.respond(input.context, scale);
            let lost = self.contacts.truncate(input);
            match self.contacts.carry(input, lost) {
                Ok(lost) => break lost,
                // The next time, near pairs are found for cloth that is carried this far.
                // The multipliers that it starts with are of this substep already.
                Err(travel) => (input.max_carry, scale) = (travel, 1.0),
            }
        };
        self.max_carry = input.max_carry;
        let are_near = self.contacts.has_near();
        if are_near {
            // Pairs that are not listed stay apart only as long as vertices move about as detection assumed.
            let cloth = ..self.bodies.first;
            let drift = self.paths.drift(Path { x: &x[cloth], u: &u[cloth], margin: &[], floats: floats(plan), workers });
            self.crossings.drifted.extend(self.contacts.finish([x, u], push, drift, workers));
            if lost != DVec3::ZERO && returns_momentum(plan, &self.bodies) {
                momentum::give_back(plan.cloth, lost, u, workers);
            }
            [self.tally.near, self.tally.contacts] = self.contacts.counts();
            self.ignore_pinched(x, u);
        }
        are_near
    }

    /// Ends a step at positions `x` (m), which those of bodies reach by `u` (m): puts what belongs to its state in the lists, counts
    /// what is squeezed, and searches for what may cross.
    pub(crate) fn end(&mut self, x: &[Vec4], u: &[Vec4], workers: Workers<'_>) {
        let may_be_others = !self.crossings.are_all || !self.crossings.drifted.is_empty();
        if may_be_others && self.too_many == 0 {
            let first = self.bodies.first;
            let ends: Vec<Vec4> = x[..first].iter().copied().chain((first..x.len()).map(|i| x[i] + u[i].with_w(0.0))).collect();
            let posed = Posed { surface: &self.surface, x: &ends, is_shared: workers.count() > 1 };
            if ends.iter().all(|x| x.is_finite()) && !self.crossings.look_around(posed) {
                self.crossings.find(posed);
                self.paths.end();
            }
        }
        // Without near pairs in the last substep, the contacts are those of another one.
        self.tally.squeezed = if self.tally.near > 0 { self.contacts.squeezed() as u32 } else { 0 };
        self.contacts.store_multipliers(&mut self.lists, workers);
    }
}
