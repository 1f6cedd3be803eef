//! The loops that move vertices out of the colliders.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::Vec4;

use super::input::{SubstepContext, Vertex};
use super::surface::lanes::store;
use super::{VERTICES_OF_PART, VERTICES_OF_THREAD};
use crate::kernels::contact::near::NearBodies;
use crate::kernels::contact::{Path, contact_bodies, contact_body};
use crate::kernels::params::Substep;
use crate::simd::{self, Loop, MAX_LANES, Registers, load_vectors, store_vectors};
use crate::step::plan::Plan;

/// Corrections of positions (m) that colliders add without changing velocities, and the length of the longest.
#[derive(Debug, Default)]
pub(super) struct Pushes {
    of: Vec<Vec4>,
    pub most: f32,
    /// Displacements (m) of all vertices of the cloth before colliders changed them; empty if there are no colliders.
    pub free: Vec<Vec4>,
}

impl Pushes {
    /// The corrections of all vertices; none if no collider pushes.
    pub(super) fn of_vertices(&self) -> &[Vec4] {
        if self.most > 0.0 { &self.of } else { &[] }
    }

    /// Moves the vertices of the cloth, which are the first, out of the colliders: by displacements and by corrections that are not part
    /// of them.
    pub(super) fn push_out(&mut self, context: SubstepContext<'_>, x: &[Vec4], u: &mut [Vec4], cloth: usize) {
        let SubstepContext { plan, substep, workers, width } = context;
        let Pushes { of, most, free } = self;
        let was_pushed = std::mem::take(most) > 0.0;
        if plan.bodies.is_empty() {
            of.clear();
            free.clear();
            return;
        }
        u[..cloth].clone_into(free);
        of.resize(x.len(), Vec4::ZERO);
        let (farthest, workers) = (AtomicU32::new(0), workers.for_items(cloth, VERTICES_OF_THREAD));
        let part = workers.part(cloth, VERTICES_OF_PART);
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

/// Moves vertices out of the colliders.
struct PushOut<'a> {
    plan: &'a Plan<'a>,
    substep: &'a Substep,
    x: &'a [Vec4],
    u: &'a mut [Vec4],
    push: &'a mut [Vec4],
    /// The square (m²) of the largest correction, as bits.
    most: &'a AtomicU32,
}

impl Loop for PushOut<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let PushOut { plan, substep, x, u, push, most } = self;
        let near = near(plan, substep, x, u);
        let zero = L::splat(0.0);
        let mut farthest = zero;
        let groups = x.chunks(L::LANES).zip(u.chunks_mut(L::LANES)).zip(push.chunks_mut(L::LANES));
        for ((x, u), push) in groups {
            let (at, by) = (load_vectors::<L>(x), load_vectors::<L>(u));
            let (from, is_free, by) = (L::transpose(at), zero.lt(L::fourth(at)), L::transpose(by));
            let Some((at, by)) = contact_bodies(from, by, is_free, &near, substep, &plan.params) else { continue };
            store_vectors(L::vectors(by), u);
            let way = at - from;
            let square = way.dot(way);
            if L::any(zero.lt(square)) {
                store_vectors(L::vectors(way), push);
                farthest = farthest.max(square);
            }
        }
        let mut all = [0.0; MAX_LANES];
        store(&mut all, farthest);
        // The bits of numbers that are not negative are in the order of the numbers.
        most.fetch_max(all.into_iter().fold(0.0, f32::max).to_bits(), Ordering::Relaxed);
    }
}

/// The bodies near some vertices.
fn near<'a>(plan: &Plan<'a>, substep: &Substep, x: &[Vec4], u: &[Vec4]) -> NearBodies<'a> {
    let state = x.iter().zip(u).map(|(x, u)| [*x, *u]);
    NearBodies::of(plan.bodies, plan.clear_in_step, substep, &plan.params, state)
}

/// Keeps vertices that pairs act on out of the colliders, as far as it changes their displacements `u`, which are
/// [`free`](Vertex::free) before.
pub(super) struct Collide<'a> {
    pub plan: &'a Plan<'a>,
    pub substep: &'a Substep,
    pub vertices: &'a [Vertex],
    pub x: &'a [Vec4],
    pub u: &'a mut [Vec4],
}

impl Loop for Collide<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Collide { plan, substep, vertices, x, u } = self;
        let near = near(plan, substep, x, u);
        let mut visit = near.visit(substep, &plan.params);
        while let Some((body, clear)) = visit.next() {
            let mut holds = true;
            let groups = x.chunks(L::LANES).zip(u.chunks_mut(L::LANES)).zip(vertices.chunks(L::LANES));
            for ((x, u), vertices) in groups {
                if !vertices.iter().any(Vertex::acts) {
                    continue;
                }
                let (at, by) = (L::transpose(load_vectors::<L>(x)), L::transpose(load_vectors::<L>(u)));
                if L::all(clear.of_vertices(at, by)) {
                    continue;
                }
                let Path { u: by, .. } = contact_body(Path::new(at, by), body, substep, &plan.params);
                holds &= near.holds(at, by);
                let mut held = [Vec4::ZERO; MAX_LANES];
                store_vectors(L::vectors(by), &mut held);
                for ((u, held), _) in u.iter_mut().zip(held).zip(vertices).filter(|(_, vertex)| vertex.acts()) {
                    *u = held;
                }
            }
            if !holds {
                visit.visit_all();
            }
        }
    }
}
