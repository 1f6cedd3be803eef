//! The end of a substep: collisions and the move. Where no force but the uniform ambient acceleration acts, this also
//! predicts the next substep's displacements.

use std::ops::Range;

use glam::{Vec3, Vec3A, Vec4};

use crate::cpu::tasks::shared::vectors::Four;
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::cpu::watch::VertexWatch;
use crate::kernels::contact::{Clear, contact_body};
use crate::kernels::integrate::{predict_displacement, xyz};
use crate::kernels::params::Substep;
use crate::simd::{self, Loop, Registers, Width};
use crate::step::plan::Plan;

/// The state, and the copy of it that a failed step is undone from.
#[derive(Debug)]
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
            simd::run(self.width, Copy { from: values.within(task), to: good.within(task), vertices: range(&tile) });
        }
    }

    /// Predicts the displacements of a tile's vertices under the ambient acceleration alone.
    pub(crate) fn fall(&self, task: &Task, tile: Range<u32>, substep: &Substep) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        simd::run(self.width, Fall { x, u, vertices: range(&tile), ambient: self.ambient(substep), carry: substep.carry });
    }

    /// Resolves collisions of some vertices, moves them, and does what `after` says.
    pub(crate) fn advance(&self, task: &Task, ranges: &[Range<u32>], substep: &Substep, after: AfterMove<'_>) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        for vertices in ranges {
            simd::run(self.width, Advance { integrator: self, x, u, vertices: range(vertices), substep, after });
        }
    }

    /// The displacement (m) that the ambient acceleration adds in a substep.
    fn ambient(&self, substep: &Substep) -> Vec4 {
        (Vec3::from(self.plan.params.acceleration) * substep.gain).extend(0.0)
    }

    /// The scalar form of [`Integrator::advance`].
    fn advance_each(&self, x: View<'_>, u: View<'_>, vertices: Range<usize>, substep: &Substep, after: AfterMove<'_>) {
        for i in vertices {
            let (from, by) = (x.get(i), u.get(i));
            let w = from.w;
            let (mut at, mut by) = (xyz(from), xyz(by));
            if w > 0.0 {
                for body in self.plan.bodies {
                    (at, by) = contact_body(at, by, body, substep, &self.plan.params);
                }
            }
            let to = (at + by).extend(w);
            let on = match after {
                AfterMove::Wait => by.extend(0.0),
                AfterMove::Fall(next) if w > 0.0 => {
                    let fall = Vec3A::from_vec4(self.ambient(next));
                    predict_displacement(by, Vec3A::splat(next.carry), fall).extend(0.0)
                }
                AfterMove::Fall(_) => Vec4::ZERO,
                AfterMove::Check => {
                    self.found.check(i, at + by, by);
                    by.extend(0.0)
                }
            };
            x.set(i, to);
            u.set(i, on);
        }
    }
}

fn range(vertices: &Range<u32>) -> Range<usize> {
    vertices.start as usize..vertices.end as usize
}

/// Copies the vectors of a tile's vertices. Tiles begin at a multiple of the SIMD width and arrays are padded to it.
struct Copy<'t> {
    from: View<'t>,
    to: View<'t>,
    vertices: Range<usize>,
}

impl Loop for Copy<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        for first in self.vertices.step_by(L::LANES) {
            let (from, to) = (self.from.row::<L>(first as u32), self.to.row::<L>(first as u32));
            for k in 0..4 {
                to.set(k, from.get(k));
            }
        }
    }
}

/// Predicts displacements of a tile's vertices. Tiles begin at a multiple of the SIMD width.
struct Fall<'t> {
    x: View<'t>,
    u: View<'t>,
    vertices: Range<usize>,
    ambient: Vec4,
    carry: f32,
}

impl Loop for Fall<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let (zero, fall, carry) = (L::splat(0.0), L::repeat(self.ambient), L::splat(self.carry));
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

/// The SIMD form of [`Integrator::advance_each`]. It handles groups of vertices that surely touch no collider and are
/// within bounds; other groups go through the scalar form.
struct Advance<'a> {
    integrator: &'a Integrator<'a>,
    x: View<'a>,
    u: View<'a>,
    vertices: Range<usize>,
    substep: &'a Substep,
    after: AfterMove<'a>,
}

impl Loop for Advance<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Advance { integrator, x, u, substep, after, .. } = self;
        let bodies = integrator.plan.bodies;
        let zero = L::splat(0.0);
        let (carry, fall) = match after {
            AfterMove::Fall(next) => (L::splat(next.carry), L::repeat(integrator.ambient(next))),
            AfterMove::Wait | AfterMove::Check => (L::splat(1.0), zero),
        };
        let fourth = zero.lt(L::repeat(Vec4::W));
        let VertexWatch { center, distance, travel, .. } = &integrator.found;
        let (center, distance, travel) = (L::repeat(center.extend(0.0)), L::splat(*distance), L::splat(*travel));
        let mut first = self.vertices.start;
        while self.vertices.end - first >= L::LANES {
            let (x_row, u_row) = (x.row::<L>(first as u32), u.row::<L>(first as u32));
            let mut clear = bodies.is_empty() || self.is_clear::<L>(first);
            if clear && matches!(after, AfterMove::Check) {
                for k in 0..4 {
                    let (from, by) = (x_row.get(k), u_row.get(k));
                    let away = L::select(fourth, zero, from + by - center);
                    let by = L::select(fourth, zero, by);
                    clear &= L::all(L::and(away.abs().lt(distance), by.abs().lt(travel)));
                }
            }
            if clear {
                for k in 0..4 {
                    let (from, by) = (x_row.get(k), u_row.get(k));
                    // The w component, the inverse mass, is kept.
                    x_row.set(k, L::select(fourth, from, from + by));
                    if matches!(after, AfterMove::Fall(_)) {
                        let on = predict_displacement(by, carry, fall);
                        u_row.set(k, L::select(fourth, zero, L::select(zero.lt(from.w()), on, zero)));
                    }
                }
            } else {
                integrator.advance_each(x, u, first..first + L::LANES, substep, after);
            }
            first += L::LANES;
        }
        integrator.advance_each(x, u, first..self.vertices.end, substep, after);
    }
}

impl Advance<'_> {
    /// Whether one group of vertices, as many as there are lanes, surely touches no collider.
    #[inline(always)]
    fn is_clear<L: Registers>(&self, first: usize) -> bool {
        let (x, u) = (self.x.vectors::<L>(first), self.u.vectors::<L>(first));
        let plan = self.integrator.plan;
        for body in plan.bodies {
            if !L::all(Clear::of(body, self.substep, plan.params.fraction).of_vertices(x, u)) {
                return false;
            }
        }
        true
    }
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_integrate.rs"]
mod tests;
