//! The end of a substep: collisions and the move. Where no force but the uniform ambient acceleration acts, this also
//! predicts the next substep's displacements.

use std::ops::Range;

use glam::{Vec3, Vec4};

use crate::cpu::tasks::shared::vectors::Four;
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::cpu::watch::VertexWatch;
use crate::kernels::contact::contact_bodies;
use crate::kernels::contact::near::NearBodies;
use crate::kernels::integrate::{predict_displacement, xyz};
use crate::kernels::params::Substep;
use crate::simd::{self, Loop, MAX_LANES, Registers, Width, load_vectors, store_vectors};
use crate::step::plan::Plan;

/// The state, and the copy of it that a failed step is undone from.
pub(crate) struct Integrator<'a> {
    pub plan: &'a Plan<'a>,
    /// Positions (m), w the inverse mass (1/kg).
    pub x: &'a SharedArray<'a>,
    /// Displacements (m) over the current substep.
    pub u: &'a SharedArray<'a>,
    /// Positions and displacements at the step's start.
    pub good: [SharedArray<'a>; 2],
    /// Defects found in the state at the step's end.
    pub found: VertexWatch,
    pub width: Width,
}

/// What follows a vertex's move.
#[derive(Debug, Clone, Copy)]
pub(crate) enum AfterMove<'a> {
    /// Nothing: the next substep's force stages predict its displacement.
    Wait,
    /// Its displacement in the next substep is predicted at once, from the ambient acceleration alone.
    Fall(&'a Substep),
    /// The step is over: check that it is within bounds.
    Check,
}

impl Integrator<'_> {
    /// Saves the state of a tile's vertices at the step's start.
    pub(crate) fn remember(&self, task: &Task, tile: Range<u32>) {
        for (values, good) in [(self.x, &self.good[0]), (self.u, &self.good[1])] {
            let (values, good) = (values.within(task), good.within(task));
            range(&tile).for_each(|vertex| good.set(vertex, values.get(vertex)));
        }
    }

    /// Predicts the displacements of a tile's vertices under the ambient acceleration alone.
    pub(crate) fn fall(&self, task: &Task, tile: Range<u32>, substep: &Substep) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        simd::run(self.width, Fall { x, u, vertices: range(&tile), substep });
    }

    /// Resolves collisions of some vertices, moves them, and does what `after` says.
    pub(crate) fn advance(&self, task: &Task, ranges: &[Range<u32>], substep: &Substep, after: AfterMove<'_>) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        let Plan { bodies, clear_in_step, params, .. } = self.plan;
        let state = ranges.iter().flat_map(range).map(|vertex| [x.get(vertex), u.get(vertex)]);
        let found = (!bodies.is_empty()).then(|| NearBodies::of(bodies, clear_in_step, substep, params, state));
        let near = found.as_ref().unwrap_or(&NearBodies::NONE);
        for vertices in ranges {
            simd::run(self.width, Advance { integrator: self, near, x, u, vertices: range(vertices), substep, after });
        }
    }
}

fn range(vertices: &Range<u32>) -> Range<usize> {
    vertices.start as usize..vertices.end as usize
}

/// [`Substep::fall`] as a vertex's displacement.
fn fall(substep: &Substep) -> Vec4 {
    Vec3::from(substep.fall).extend(0.0)
}

/// Predicts displacements of a tile's vertices. Tiles begin at a multiple of the SIMD width.
struct Fall<'t> {
    x: View<'t>,
    u: View<'t>,
    vertices: Range<usize>,
    substep: &'t Substep,
}

impl Loop for Fall<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let (zero, fall, carry) = (L::splat(0.0), L::repeat(fall(self.substep)), L::splat(self.substep.carry));
        let fourth = zero.lt(L::repeat(Vec4::W));
        for first in self.vertices.step_by(L::LANES) {
            let (x, u) = (self.x.row::<L>(first as u32), self.u.row::<L>(first as u32));
            for k in 0..4 {
                let on = predict_displacement(u.get(k), carry, fall);
                u.set(k, L::select(fourth, zero, L::select(zero.lt(x.get(k).w()), on, zero)));
            }
        }
    }
}

/// Resolves collisions, moves vertices, and predicts or checks.
struct Advance<'a> {
    integrator: &'a Integrator<'a>,
    near: &'a NearBodies<'a>,
    x: View<'a>,
    u: View<'a>,
    vertices: Range<usize>,
    substep: &'a Substep,
    after: AfterMove<'a>,
}

impl Loop for Advance<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let mut first = self.vertices.start;
        while self.vertices.end - first >= L::LANES {
            let (x, u) = (self.x.row::<L>(first as u32), self.u.row::<L>(first as u32));
            let (mut at, mut by) = ([x.get(0), x.get(1), x.get(2), x.get(3)], [u.get(0), u.get(1), u.get(2), u.get(3)]);
            self.group(&mut at, &mut by, first, L::LANES);
            for k in 0..4 {
                x.set(k, at[k]);
                u.set(k, by[k]);
            }
            first += L::LANES;
        }
        let count = self.vertices.end - first;
        if count > 0 {
            let (mut x, mut u) = ([Vec4::ZERO; MAX_LANES], [Vec4::ZERO; MAX_LANES]);
            for lane in 0..count {
                (x[lane], u[lane]) = (self.x.get(first + lane), self.u.get(first + lane));
            }
            let (mut at, mut by) = (load_vectors::<L>(&x[..count]), load_vectors::<L>(&u[..count]));
            self.group(&mut at, &mut by, first, count);
            store_vectors(at, &mut x);
            store_vectors(by, &mut u);
            for lane in 0..count {
                self.x.set(first + lane, x[lane]);
                self.u.set(first + lane, u[lane]);
            }
        }
    }
}

impl Advance<'_> {
    /// Advances the positions and displacements of one group of vertices, the first `count` of which are to be checked.
    #[inline(always)]
    fn group<L: Registers>(&self, x: &mut [L; 4], u: &mut [L; 4], first: usize, count: usize) {
        let integrator = self.integrator;
        let zero = L::splat(0.0);
        let fourth = zero.lt(L::repeat(Vec4::W));
        if !integrator.plan.bodies.is_empty() {
            self.collide(x, u);
        }
        for k in 0..4 {
            // The w component, the inverse mass, is kept.
            x[k] = L::select(fourth, x[k], x[k] + u[k]);
        }
        match self.after {
            AfterMove::Wait => {}
            AfterMove::Fall(next) => {
                let (carry, fall) = (L::splat(next.carry), L::repeat(fall(next)));
                for k in 0..4 {
                    let on = predict_displacement(u[k], carry, fall);
                    u[k] = L::select(fourth, zero, L::select(zero.lt(x[k].w()), on, zero));
                }
            }
            AfterMove::Check => {
                let VertexWatch { center, distance, travel, .. } = &integrator.found;
                let (center, distance, travel) = (L::repeat(center.extend(0.0)), L::splat(*distance), L::splat(*travel));
                let mut within = true;
                for k in 0..4 {
                    let away = L::select(fourth, zero, x[k] - center);
                    let by = L::select(fourth, zero, u[k]);
                    within &= L::all(L::and(away.abs().lt(distance), by.abs().lt(travel)));
                }
                if !within {
                    let (mut at, mut by) = ([Vec4::ZERO; MAX_LANES], [Vec4::ZERO; MAX_LANES]);
                    store_vectors(*x, &mut at);
                    store_vectors(*u, &mut by);
                    (0..count).for_each(|lane| integrator.found.check(first + lane, xyz(at[lane]), xyz(by[lane])));
                }
            }
        }
    }

    /// Resolves collisions of a group of vertices.
    #[inline(always)]
    fn collide<L: Registers>(&self, x: &mut [L; 4], u: &mut [L; 4]) {
        let plan = self.integrator.plan;
        let is_free = L::splat(0.0).lt(L::fourth(*x));
        let (at, by) = (L::transpose(*x), L::transpose(*u));
        let Some((at, by)) = contact_bodies(at, by, is_free, self.near, self.substep, &plan.params) else { return };
        let fourth = L::splat(0.0).lt(L::repeat(Vec4::W));
        let (at, by) = (L::vectors(at), L::vectors(by));
        for k in 0..4 {
            x[k] = L::select(fourth, x[k], at[k]);
            u[k] = by[k];
        }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_integrate.rs"]
mod tests;
