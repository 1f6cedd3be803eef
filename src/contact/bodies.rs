//! Mesh colliders ("bodies"). Their vertices follow the cloth's in the arrays, have no inverse mass, and move in
//! straight lines during a step.

use std::sync::Arc;

use glam::{Vec3, Vec3A, Vec4};

use super::frame::Frame;
use crate::kernels::integrate::xyz;
use crate::kernels::params::Substep;
use crate::model::mesh::Mesh;
use crate::step::plan::Plan;

/// A vertex of a body counts as near the cloth if it is within the cloth's bounding box, enlarged by this share of its
/// largest extent.
pub(super) const NEAR: f32 = 0.1;

/// The mesh colliders, from step to step.
#[derive(Debug)]
pub(super) struct Bodies {
    /// Index of their first vertex.
    pub first: usize,
    /// Their meshes at the end of the step, which are part of the state.
    pub last: Vec<Arc<Mesh>>,
    /// Whether none of them moves in this step, and whether detection (on a GPU: the device) knows them where they are.
    pub are_still: bool,
    pub are_known: bool,
    /// Range, per coordinate, of the displacements (m) in this step of vertices near the cloth, if there are any.
    travel: Option<[Vec3; 2]>,
    /// Coefficients of friction: the cloth's with itself, then that of each body.
    pub friction: Vec<f32>,
}

impl Bodies {
    pub(super) fn new(first: usize, last: Vec<Arc<Mesh>>) -> Bodies {
        Bodies { first, last, are_still: false, are_known: false, travel: None, friction: Vec::new() }
    }

    /// Whether these meshes have the same triangles.
    pub(super) fn are<'a>(&self, meshes: impl ExactSizeIterator<Item = &'a Arc<Mesh>>) -> bool {
        self.last.len() == meshes.len() && self.last.iter().zip(meshes).all(|(last, mesh)| last.has_triangles_of(mesh))
    }

    /// Replaces the positions at the end of the last step.
    pub(super) fn forget(&mut self, last: &[Arc<Mesh>]) {
        self.last.clone_from_slice(last);
        (self.are_still, self.are_known) = (false, false);
    }

    /// Begins a step; `friction` is that of the cloth with itself. Returns whether a body starts elsewhere than where the
    /// last step left it.
    pub(super) fn begin(&mut self, plan: &Plan<'_>, friction: f32) -> bool {
        let meshes = plan.meshes;
        let coefficients = || std::iter::once(friction).chain(meshes.iter().map(|body| body.friction));
        self.are_known &= coefficients().eq(self.friction.iter().copied());
        self.friction.clear();
        self.friction.extend(coefficients());
        let is_same = |a: &Arc<Mesh>, b: &Arc<Mesh>| Arc::ptr_eq(a, b) || a.positions == b.positions;
        let jumped = !self.last.iter().zip(meshes).all(|(last, body)| is_same(last, &body.from));
        let are_still = meshes.iter().all(|body| is_same(&body.from, &body.to));
        self.are_known &= are_still && self.are_still && !jumped;
        self.are_still = are_still;
        for (last, body) in self.last.iter_mut().zip(meshes) {
            last.clone_from(&body.to);
        }
        jumped
    }

    /// Puts them where the step begins.
    pub(super) fn place(&mut self, plan: &Plan<'_>, x: &mut [Vec4], u: &mut [Vec4]) {
        self.travel = travel_near(plan, x);
        self.put(plan, 0.0, 0.0, x, u);
    }

    /// Moves them through a substep.
    pub(super) fn lead(&self, plan: &Plan<'_>, substep: &Substep, x: &mut [Vec4], u: &mut [Vec4]) {
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

    /// The common motion of everything that moves from outside, pins and bodies, in a substep: the midpoint of the range of
    /// their displacements, and also a turn if there are only pins and these turn. `None` if there is neither.
    ///
    /// Motion is measured relative to it, so that cloth riding on a body is at rest however fast the body is. If the
    /// range is larger than the substeps resolve ([`ContactOutruns`](crate::Warning::ContactOutruns)), it is zero,
    /// because otherwise cloth that touches neither would seem to move.
    pub(super) fn frame(&self, plan: &Plan<'_>, x: &[Vec4], u: &[Vec4], thickness: f32) -> Option<Frame> {
        let of_bodies = self.travel.map(|travel| travel.map(|by| Vec3A::from(by * plan.params.fraction)));
        let pins = plan.cloth.pinned.iter().map(|&pin| (xyz(x[pin as usize]), xyz(u[pin as usize])));
        let turning = if of_bodies.is_none() { Frame::of_pins(pins.clone(), thickness) } else { None };
        let range = pins.fold(of_bodies, |range, (_, by)| {
            let [low, high] = range.unwrap_or([by; 2]);
            Some([low.min(by), high.max(by)])
        });
        let middle = |[low, high]: [Vec3A; 2]| match low.distance(high) < thickness {
            true => (low + high) * 0.5,
            false => Vec3A::ZERO,
        };
        let range = range.or_else(|| (self.first < u.len()).then_some([Vec3A::ZERO; 2]));
        turning.or_else(|| range.map(middle).map(Frame::of))
    }
}

/// For each vertex of the bodies its position at the start of a step (m, in local coordinates) and its displacement in
/// the step (m).
pub(super) fn motions(plan: &Plan<'_>) -> impl Iterator<Item = [Vec3; 2]> {
    let vertices = plan.meshes.iter().flat_map(|body| body.from.positions.iter().zip(&body.to.positions));
    vertices.map(|(&from, &to)| [from - plan.cloth.origin, to - from])
}

/// [`Bodies::travel`]: the range of the displacements of vertices near the cloth.
fn travel_near(plan: &Plan<'_>, x: &[Vec4]) -> Option<[Vec3; 2]> {
    let cloth = x[..plan.cloth.rest.len()].iter().map(|x| x.truncate() + plan.cloth.origin);
    let [low, high] = cloth.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
    let margin = Vec3::splat(NEAR * (high - low).max_element());
    let is_near = |&(from, to): &(Vec3, Vec3)| {
        let by = (to - from).abs();
        let (least, most) = (from.min(to) - by - margin, from.max(to) + by + margin);
        least.cmple(high).all() && most.cmpge(low).all()
    };
    let pairs = plan.meshes.iter().flat_map(|body| body.from.positions.iter().copied().zip(body.to.positions.iter().copied()));
    pairs.filter(is_near).map(|(from, to)| to - from).fold(None, |travel, by| {
        let [low, high] = travel.unwrap_or([by; 2]);
        Some([low.min(by), high.max(by)])
    })
}
