//! Mesh colliders ("bodies"). Their vertices follow the cloth's in the arrays, have no inverse mass, and move in
//! straight lines during a step.

use std::sync::Arc;

use glam::{Vec3, Vec3A, Vec4};

use super::common_motion::CommonMotion;
use crate::kernels::integrate::xyz;
use crate::kernels::params::Substep;
use crate::model::mesh::{Mesh, around, bounds};
use crate::step::load::STEPS_AHEAD;
use crate::step::motion::Whereabouts;
use crate::step::plan::{MeshBody, Plan};

/// A vertex of a body counts as near the cloth if it is within the cloth's bounding box, enlarged by this share of its
/// largest extent.
pub(super) const NEAR: f32 = 0.1;

/// The mesh colliders, from step to step.
#[derive(Default)]
#[expect(clippy::struct_excessive_bools, reason = "they are independent of each other")]
pub(crate) struct Bodies {
    /// Index of their first vertex.
    pub first: usize,
    /// The meshes that their triangles were numbered for: see [`Surface`](super::surface::Surface).
    pub numbered: Vec<Arc<Mesh>>,
    /// Their meshes at the end of the step, which are part of the state; empty if there was none since the state was set.
    pub last: Vec<Arc<Mesh>>,
    /// Whether none of them moves in this step, and whether detection (on a GPU: the device) knows them where they are.
    pub are_still: bool,
    pub are_known: bool,
    /// Whether one of them may come near the cloth in this step. Otherwise the cloth moves as if there were none.
    pub may_meet: bool,
    /// Indices of their vertices that are near the cloth in this step.
    near: Vec<u32>,
    /// Range, per coordinate, of the displacements (m) of these vertices in this step, if there are any.
    travel: Option<[Vec3; 2]>,
    /// Whether they and the pins turn in this step, all together.
    turn: bool,
    /// Coefficients of friction: the cloth's with itself, then that of each body.
    pub friction: Vec<f32>,
}

impl Bodies {
    pub(super) fn new(first: usize, numbered: Vec<Arc<Mesh>>) -> Bodies {
        let last = Vec::with_capacity(numbered.len());
        let near = Vec::with_capacity(numbered.iter().map(|mesh| mesh.positions.len()).sum());
        Bodies { first, numbered, last, near, ..Bodies::default() }
    }

    /// Whether a step can go on with these meshes: they have the same triangles, and in the first step after the state was
    /// set they are also where the triangles were numbered, so that nothing depends on what was before.
    pub(crate) fn are_of<'a>(&self, meshes: impl ExactSizeIterator<Item = &'a Arc<Mesh>> + Clone) -> bool {
        if self.last.is_empty() {
            return self.are_numbered_for(meshes);
        }
        self.last.len() == meshes.len() && self.last.iter().zip(meshes).all(|(last, mesh)| last.has_triangles_of(mesh))
    }

    /// Whether their triangles were numbered for these meshes.
    pub(crate) fn are_numbered_for<'a>(&self, meshes: impl ExactSizeIterator<Item = &'a Arc<Mesh>>) -> bool {
        let is_same = |(one, other): (&Arc<Mesh>, &Arc<Mesh>)| is_same_place(one, other) && one.has_triangles_of(other);
        self.numbered.len() == meshes.len() && self.numbered.iter().zip(meshes).all(is_same)
    }

    /// Forgets the last step, because the state was replaced.
    pub(super) fn forget(&mut self) {
        self.last.clear();
        (self.are_still, self.are_known) = (false, false);
    }

    /// Goes back to the end of another step. Returns false, and changes nothing, if these are not its meshes.
    pub(super) fn go_back(&mut self, last: &[Arc<Mesh>]) -> bool {
        let is_same = |(one, last): (&Arc<Mesh>, &Arc<Mesh>)| one.has_triangles_of(last);
        let are_same = last.len() == self.numbered.len() && self.numbered.iter().zip(last).all(is_same);
        if !(last.is_empty() || are_same) {
            return false;
        }
        self.forget();
        self.last.extend_from_slice(last);
        true
    }

    /// Begins a step; `friction` is that of the cloth with itself, `thickness` (m) that of contact. Returns whether a body starts
    /// elsewhere than where the last step left it.
    pub(super) fn begin(&mut self, plan: &Plan<'_>, friction: f32, thickness: f32) -> bool {
        let meshes = plan.meshes;
        self.may_meet = may_meet(plan, thickness);
        let coefficients = || std::iter::once(friction).chain(meshes.iter().map(|body| body.friction));
        self.are_known &= coefficients().eq(self.friction.iter().copied());
        self.friction.clear();
        self.friction.extend(coefficients());
        let jumped = !self.last.iter().zip(meshes).all(|(last, body)| is_same_place(last, &body.from));
        let are_still = meshes.iter().all(|body| is_same_place(&body.from, &body.to));
        self.are_known &= are_still && self.are_still && !jumped;
        self.are_still = are_still;
        self.last.clear();
        self.last.extend(meshes.iter().map(|body| Arc::clone(&body.to)));
        jumped
    }

    /// Puts them where the step begins.
    pub(super) fn place(&mut self, plan: &Plan<'_>, thickness: f32, x: &mut [Vec4], u: &mut [Vec4]) {
        self.travel = self.find_near(plan, x);
        self.put(plan, 0.0, plan.params.fraction, x, u);
        // The fit takes longer than to move the bodies, so one that deforms is tried once in a step.
        let near = self.near.iter().map(|&vertex| motion_of(vertex, x, u));
        self.turn = CommonMotion::of_kinematic(kinematic_pins(plan).chain(near), thickness).is_some();
    }

    /// Moves them through a substep.
    pub(super) fn advance(&self, plan: &Plan<'_>, substep: &Substep, x: &mut [Vec4], u: &mut [Vec4]) {
        if !self.are_still {
            self.put(plan, substep.start, plan.params.fraction, x, u);
        }
    }

    /// Sets their positions after a share `start` of the step, and their displacements for a share `fraction` of it.
    fn put(&self, plan: &Plan<'_>, start: f32, fraction: f32, x: &mut [Vec4], u: &mut [Vec4]) {
        for ([from, travel], (x, u)) in motions(plan).zip(x[self.first..].iter_mut().zip(&mut u[self.first..])) {
            *x = (from + travel * start).extend(0.0);
            *u = (travel * fraction).extend(0.0);
        }
    }

    /// The common motion of everything that moves from outside, pins and bodies, in a substep: the rigid motion that fits
    /// them, or the midpoint of the range of their displacements if they do not move rigidly. `None` if there are no pins, and no
    /// body may meet the cloth in this step.
    ///
    /// Motion is measured relative to it, so that cloth riding on a body is at rest however fast the body is. If the
    /// range is larger than the substeps resolve ([`ContactOutruns`](crate::Warning::ContactOutruns)), it is zero,
    /// because otherwise cloth that touches neither would seem to move.
    pub(super) fn common_motion(&self, plan: &Plan<'_>, x: &[Vec4], u: &[Vec4], thickness: f32) -> Option<CommonMotion> {
        // Pinned vertices without edges are not part of the cloth.
        let pins = plan.cloth.pinned.iter().filter(|&&pin| plan.cloth.is_used(pin)).map(|&pin| motion_of(pin, x, u));
        let turning =
            || CommonMotion::of_kinematic(pins.clone().chain(self.near.iter().map(|&vertex| motion_of(vertex, x, u))), thickness);
        let of_bodies = self.travel.map(|travel| travel.map(|by| Vec3A::from(by * plan.params.fraction)));
        let range = pins.clone().fold(of_bodies, |range, (_, by)| {
            let [low, high] = range.unwrap_or([by; 2]);
            Some([low.min(by), high.max(by)])
        });
        let middle = |[low, high]: [Vec3A; 2]| if low.distance(high) < thickness { (low + high) * 0.5 } else { Vec3A::ZERO };
        let range = range.or_else(|| self.may_meet.then_some([Vec3A::ZERO; 2]));
        self.turn.then(turning).flatten().or_else(|| range.map(middle).map(CommonMotion::of))
    }

    /// Lists the vertices near the cloth, and returns [`Bodies::travel`].
    fn find_near(&mut self, plan: &Plan<'_>, x: &[Vec4]) -> Option<[Vec3; 2]> {
        let cloth = bounds(x[..plan.cloth.used].iter().map(|x| x.truncate()));
        self.near.clear();
        let mut travel = None;
        if !self.may_meet {
            return travel;
        }
        for (vertex, motion) in (self.first as u32..).zip(motions(plan)).filter(|(_, motion)| is_near(*motion, cloth)) {
            self.near.push(vertex);
            let [_, by] = motion;
            let [low, high] = travel.unwrap_or([by; 2]);
            travel = Some([low.min(by), high.max(by)]);
        }
        travel
    }
}

/// Whether a vertex of a body, given by where a step begins and its displacement in it, is near a cloth in these bounds (m).
pub(super) fn is_near([from, by]: [Vec3; 2], [low, high]: [Vec3; 2]) -> bool {
    let [least, most] = around([from, by], by.abs() + NEAR * (high - low).max_element());
    least.cmple(high).all() && most.cmpge(low).all()
}

/// Whether a mesh collider may come near the cloth in this step: within a share [`NEAR`] of its largest extent, the thickness (m), and
/// what it may move besides its course. True if it is not known where the cloth is.
fn may_meet(plan: &Plan<'_>, thickness: f32) -> bool {
    let Some(Whereabouts { low, high, fastest }) = plan.whereabouts else { return !plan.meshes.is_empty() };
    let dt = plan.params.h / plan.params.fraction;
    let reach = NEAR * (high - low).max_element() + STEPS_AHEAD as f32 * fastest * dt + 2.0 * thickness;
    let (low, high) = (low - reach, high + reach);
    // Written so that a place that is no number counts as near.
    let is_away = |[least, most]: [Vec3; 2]| least.cmpgt(high).any() || most.cmplt(low).any();
    plan.meshes.iter().any(|body| {
        let origin = plan.cloth.origin;
        let ends = |vertex: u32| [&body.from, &body.to].map(|mesh| mesh.positions[vertex as usize] - origin);
        let all = || motions_of(body, origin).flat_map(|[from, by]| [from, from + by]);
        // A triangle may be larger than the cloth, and have all its corners elsewhere.
        let of_triangle = |corners: &[u32; 3]| bounds(corners.iter().flat_map(|&corner| ends(corner)));
        !is_away(bounds(all())) && body.to.triangles.iter().any(|corners| !is_away(of_triangle(corners)))
    })
}

/// Whether the vertices of two meshes are in the same places.
fn is_same_place(one: &Arc<Mesh>, other: &Arc<Mesh>) -> bool {
    Arc::ptr_eq(one, other) || one.positions == other.positions
}

/// The place (m) and the displacement (m) of a vertex that is moved from outside.
fn motion_of(vertex: u32, x: &[Vec4], u: &[Vec4]) -> (Vec3A, Vec3A) {
    (xyz(x[vertex as usize]), xyz(u[vertex as usize]))
}

/// The places (m) of the pins at the start of a step, and their displacements (m) in its first substep.
pub(super) fn kinematic_pins(plan: &Plan<'_>) -> impl Iterator<Item = (Vec3A, Vec3A)> + Clone {
    let pins = plan.cloth.pinned.iter().zip(plan.pins_from).filter(|(vertex, _)| plan.cloth.is_used(**vertex));
    pins.map(|(&vertex, &from)| {
        let pin = plan.pins.binary_search_by_key(&vertex, |pin| pin.vertex).map(|place| &plan.pins[place]);
        let by = pin.map_or(Vec3::ZERO, |pin| (Vec3::from(pin.goal) - Vec3::from(pin.origin)) * plan.params.fraction);
        (Vec3A::from(from), Vec3A::from(by))
    })
}

/// For each vertex of the bodies its position at the start of a step (m, in local coordinates) and its displacement in
/// the step (m).
pub(super) fn motions(plan: &Plan<'_>) -> impl Iterator<Item = [Vec3; 2]> + Clone {
    plan.meshes.iter().flat_map(|body| motions_of(body, plan.cloth.origin))
}

/// The motions of the vertices of one body, as in [`motions`], in a loop that compilers vectorize. `origin` is that of
/// the local coordinates (m).
pub(super) fn motions_of(body: &MeshBody, origin: Vec3) -> impl Iterator<Item = [Vec3; 2]> + Clone {
    body.from.positions.iter().zip(&body.to.positions).map(move |(&from, &to)| [from - origin, to - from])
}
