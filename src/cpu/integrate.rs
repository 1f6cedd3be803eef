//! The end of a substep: contact and the move; and where no force but the ambient acceleration acts, the start of the next.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{Vec3, Vec3A, Vec4};

use crate::cpu::tasks::shared::{Four, SharedArray, Task, View};
use crate::kernels::contact::{Clear, contact_body};
use crate::kernels::integrate::{predict_displacement, xyz};
use crate::kernels::params::Substep;
use crate::limits::MAX_POSITION;
use crate::simd::{self, Loop, Registers, Width};
use crate::step::plan::Plan;

/// The state, and where it goes back to.
#[derive(Debug)]
pub(crate) struct Integrator<'a> {
    pub plan: &'a Plan<'a>,
    /// Positions (m), w the inverse mass (1/kg).
    pub x: &'a SharedArray<'a>,
    /// Displacements (m) over the substep.
    pub u: &'a SharedArray<'a>,
    /// Both, where the step began.
    pub good: [SharedArray<'a>; 2],
    /// The first vertex that left the bounds.
    pub lost: AtomicUsize,
    pub width: Width,
}

/// What becomes of a vertex after its substep.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Then<'a> {
    /// It waits for forces.
    Wait,
    /// It falls on: its displacement in the next substep is predicted.
    Fall(&'a Substep),
    /// It ends the step: is it within bounds?
    Check,
}

impl Integrator<'_> {
    /// Remembers the state of a tile's vertices.
    pub(crate) fn remember(&self, task: &Task, tile: Range<u32>) {
        for (values, good) in [(self.x, &self.good[0]), (self.u, &self.good[1])] {
            simd::run(self.width, Copy { from: values.within(task), to: good.within(task), vertices: range(&tile) });
        }
    }

    /// Predicts what a tile's vertices will do under the ambient acceleration alone.
    pub(crate) fn fall(&self, task: &Task, tile: Range<u32>, substep: &Substep) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        simd::run(self.width, Fall { x, u, vertices: range(&tile), fall: self.ambient(substep), carry: substep.carry });
    }

    /// Contact, the move, and what comes then.
    pub(crate) fn advance(&self, task: &Task, ranges: &[Range<u32>], substep: &Substep, then: Then<'_>) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        for vertices in ranges {
            simd::run(self.width, Advance { integrator: self, x, u, vertices: range(vertices), substep, then });
        }
    }

    /// What the ambient acceleration moves a vertex by (m).
    fn ambient(&self, substep: &Substep) -> Vec4 {
        (Vec3::from(self.plan.params.acceleration) * substep.gain).extend(0.0)
    }

    /// [`Integrator::advance`] of one vertex after another.
    fn advance_each(&self, x: View<'_>, u: View<'_>, vertices: Range<usize>, substep: &Substep, then: Then<'_>) {
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
            let on = match then {
                Then::Wait => by.extend(0.0),
                Then::Fall(next) if w > 0.0 => {
                    let fall = Vec3A::from_vec4(self.ambient(next));
                    predict_displacement(by, Vec3A::splat(next.carry), fall).extend(0.0)
                }
                Then::Fall(_) => Vec4::ZERO,
                Then::Check => {
                    let bounded = |v: Vec4| v.truncate().abs().cmple(Vec3::splat(MAX_POSITION)).all();
                    // NaN is not below the limit either.
                    if !(bounded(to) && bounded(by.extend(0.0))) {
                        self.lost.fetch_min(i, Ordering::Relaxed);
                    }
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

/// Copies vertices of a tile, which begins with a whole group.
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

/// Predicts vertices of a tile, which begins with a whole group.
struct Fall<'t> {
    x: View<'t>,
    u: View<'t>,
    vertices: Range<usize>,
    fall: Vec4,
    carry: f32,
}

impl Loop for Fall<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let (zero, fall, carry) = (L::splat(0.0), L::repeat(self.fall), L::splat(self.carry));
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

/// [`Integrator::advance_each`] of many vertices together, where they are clear of all bodies and nothing is wrong.
struct Advance<'a> {
    integrator: &'a Integrator<'a>,
    x: View<'a>,
    u: View<'a>,
    vertices: Range<usize>,
    substep: &'a Substep,
    then: Then<'a>,
}

impl Loop for Advance<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Advance { integrator, x, u, substep, then, .. } = self;
        let bodies = integrator.plan.bodies;
        let zero = L::splat(0.0);
        let (carry, fall) = match then {
            Then::Fall(next) => (L::splat(next.carry), L::repeat(integrator.ambient(next))),
            Then::Wait | Then::Check => (L::splat(1.0), zero),
        };
        let fourth = zero.lt(L::repeat(Vec4::W));
        let most = L::splat(MAX_POSITION);
        let mut first = self.vertices.start;
        while self.vertices.end - first >= L::LANES {
            let (x_row, u_row) = (x.row::<L>(first as u32), u.row::<L>(first as u32));
            let mut clear = bodies.is_empty() || self.is_clear::<L>(first);
            if clear && matches!(then, Then::Check) {
                for k in 0..4 {
                    let (from, by) = (x_row.get(k), u_row.get(k));
                    let to = L::select(fourth, zero, from + by);
                    clear &= L::all(L::and(to.abs().lt(most), L::select(fourth, zero, by).abs().lt(most)));
                }
            }
            if clear {
                for k in 0..4 {
                    let (from, by) = (x_row.get(k), u_row.get(k));
                    // The inverse mass stays.
                    x_row.set(k, L::select(fourth, from, from + by));
                    if matches!(then, Then::Fall(_)) {
                        let on = predict_displacement(by, carry, fall);
                        u_row.set(k, L::select(fourth, zero, L::select(zero.lt(from.w()), on, zero)));
                    }
                }
            } else {
                integrator.advance_each(x, u, first..first + L::LANES, substep, then);
            }
            first += L::LANES;
        }
        integrator.advance_each(x, u, first..self.vertices.end, substep, then);
    }
}

impl Advance<'_> {
    /// Whether as many vertices as lanes surely meet no body.
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
mod tests {
    use super::*;
    use crate::model::cloth::Cloth;
    use crate::simd::aligned::AlignedVec;
    use crate::step::coefficients::Coefficients;
    use crate::step::plan::{Motion, PlanBuffers};
    use crate::{Attributes, Collider, Mesh, Options};

    /// Vertices near bodies and far, slow and fast, together and one by one: the same bits.
    #[test]
    fn what_is_told_to_be_clear_is_clear() {
        let options = Options { pinned: vec![3, 70], ..Options::default() };
        let cloth = Cloth::new(&Mesh::grid(64, 65, 1.0, 1.0), &options).unwrap();
        let h = 1.0 / 1200.0;
        let coefficients = Coefficients::new(&cloth, &[], &options, h);
        let at = |y: f32| glam::Vec3::new(0.2, y, -0.1);
        let bodies = [
            Collider::sphere(at(0.1), 0.3),
            Collider::capsule(at(0.4), at(-0.6), 0.2),
            Collider::plane(at(-0.2), glam::Vec3::new(0.6, 0.8, 0.0)),
        ];
        for (body, far, size) in
            bodies.into_iter().flat_map(|b| [(1.0, 1e-4), (1.0, 0.03), (1.0, 0.5), (20.0, 0.01)].map(|(f, s)| (b, f, s)))
        {
            // It comes from elsewhere, so that it moves within the step.
            let before = match body.shape {
                _ if size > 0.1 => body,
                _ => Collider::sphere(at(0.3), 0.25),
            };
            let attributes = Attributes { colliders: vec![body], ..Attributes::default() };
            let (mut lists, motion) = (PlanBuffers::default(), Motion { h, colliders: vec![before], ..Motion::default() });
            let plan = Plan::new(&cloth, &[], &options, &coefficients, &motion, 2, &attributes, &mut lists);
            let mut random = fastrand::Rng::with_seed(8);
            let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
            let count = cloth.rest.len();
            let start: Vec<[Vec4; 2]> = cloth
                .rest
                .iter()
                .map(|rest| [(rest.truncate() * far + vector(0.3)).extend(rest.w), vector(size).extend(0.0)])
                .collect();
            let run = |width: Option<Width>| {
                let [mut x, mut u, mut none] = [count, count, 0].map(AlignedVec::new);
                start.iter().enumerate().for_each(|(v, [at, by])| (x[v], u[v]) = (*at, *by));
                let (shared_x, shared_u, task) = (SharedArray::new(x.room()), SharedArray::new(u.room()), Task::alone());
                let good = [SharedArray::new(none.room()), SharedArray::new(&mut [])];
                let lost = AtomicUsize::new(usize::MAX);
                let (x_view, u_view) = (&shared_x, &shared_u);
                let integrator =
                    Integrator { plan: &plan, x: x_view, u: u_view, good, lost, width: width.unwrap_or(Width::detected()) };
                let (substep, then) = (&plan.substeps[0], Then::Fall(&plan.substeps[1]));
                match width {
                    Some(_) => integrator.advance(&task, &[0..37, 37..count as u32], substep, then),
                    None => integrator.advance_each(x_view.within(&task), u_view.within(&task), 0..count, substep, then),
                }
                [x, u].map(|values| values.iter().map(|v| v.to_array()).collect::<Vec<_>>())
            };
            let one = run(None);
            for (one, many) in Width::all().into_iter().map(|w| run(Some(w))).flat_map(|many| one.clone().into_iter().zip(many)) {
                let same = |a: &[f32; 4], b: &[f32; 4]| a[..3].iter().zip(&b[..3]).all(|(a, b)| a == b);
                let first = one.iter().zip(&many).position(|(a, b)| !same(a, b));
                assert!(first.is_none(), "{:?} {far} {size}: vertex {first:?}", body.shape);
            }
        }
    }
}
