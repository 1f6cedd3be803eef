//! Contact, and the move: the end of a substep, and where no force but the ambient acceleration acts, the start of the next.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{Vec3, Vec3A, Vec4};

use crate::cpu::shared::Shared;
use crate::kernels::{self, Body, PLANE, Substep, xyz};
use crate::limits::MAX_POSITION;
use crate::simd::{self, At, Breadth, Loop, Wide};
use crate::step::plan::Plan;

/// The loops over vertices that a task owns.
#[derive(Debug)]
pub(crate) struct Moves<'a> {
    pub plan: &'a Plan<'a>,
    pub x: Shared<Vec4>,
    pub u: Shared<Vec4>,
    /// Where the state goes back to if the step fails.
    pub good: [Shared<Vec4>; 2],
    /// The first vertex that left the bounds.
    pub lost: &'a AtomicUsize,
    pub breadth: Breadth,
}

/// What a vertex does after its substep.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Then<'a> {
    /// It waits for forces.
    Wait,
    /// It is predicted to fall on.
    Fall(&'a Substep),
    /// It ends the step: is it still somewhere?
    Check,
}

#[expect(unsafe_code, reason = "tasks of a round own their vertices")]
impl Moves<'_> {
    /// Remembers the state of these vertices.
    pub(crate) fn remember(&self, vertices: Range<u32>) {
        for (values, good) in [(self.x, self.good[0]), (self.u, self.good[1])] {
            // SAFETY: the task's own vertices.
            vertices.clone().for_each(|i| unsafe { good.set(i as usize, values.get(i as usize)) });
        }
    }

    /// Contact, the move, and what comes then.
    pub(crate) fn advance(&self, ranges: &[Range<u32>], substep: &Substep, then: Then<'_>) {
        for range in ranges {
            let vertices = range.start as usize..range.end as usize;
            #[cfg(test)]
            if self.breadth == Breadth::One {
                self.each(vertices, substep, then);
                continue;
            }
            // SAFETY: the breadth was detected; the task's own vertices.
            unsafe { simd::run(self.breadth, Advance { moves: self, vertices, substep, then }) };
        }
    }

    fn each(&self, vertices: Range<usize>, substep: &Substep, then: Then<'_>) {
        let ambient = Vec3A::from(self.plan.params.acceleration);
        for i in vertices {
            // SAFETY: the task's own vertices.
            let (x, u) = unsafe { (self.x.get(i), self.u.get(i)) };
            let (mut at, mut by) = (xyz(x), xyz(u));
            if x.w > 0.0 {
                for body in self.plan.bodies {
                    (at, by) = kernels::contact(at, by, body, substep, &self.plan.params);
                }
            }
            let to = (at + by).extend(x.w);
            let on = match then {
                Then::Wait => by.extend(0.0),
                Then::Fall(next) => fallen(x.w, by, ambient, next),
                Then::Check => {
                    let bounded = |v: Vec4| v.truncate().abs().cmple(Vec3::splat(MAX_POSITION)).all();
                    // NaN is not below the limit either.
                    if !(bounded(to) && bounded(by.extend(0.0))) {
                        self.lost.fetch_min(i, Ordering::Relaxed);
                    }
                    by.extend(0.0)
                }
            };
            // SAFETY: as above.
            unsafe {
                self.x.set(i, to);
                self.u.set(i, on);
            }
        }
    }
}

/// [`Moves::each`] of many vertices together, where they are clear of all bodies and nothing is wrong.
struct Advance<'a> {
    moves: &'a Moves<'a>,
    vertices: Range<usize>,
    substep: &'a Substep,
    then: Then<'a>,
}

#[expect(unsafe_code, reason = "see Moves")]
impl Loop for Advance<'_> {
    #[inline(always)]
    unsafe fn run<W: Wide>(self) {
        let Moves { plan, x, u, .. } = *self.moves;
        let (zero, group) = (W::splat(0.0), W::LANES / 4);
        let (carry, gravity) = match self.then {
            Then::Fall(next) => (W::splat(next.carry), W::repeat((Vec3::from(plan.params.acceleration) * next.gain).extend(0.0))),
            Then::Wait | Then::Check => (W::splat(1.0), zero),
        };
        let fourth = zero.below(W::repeat(Vec4::W));
        let most = W::splat(MAX_POSITION);
        let mut first = self.vertices.start;
        while self.vertices.end - first >= W::LANES {
            // SAFETY: the task's own vertices.
            unsafe {
                let mut clear = plan.bodies.is_empty() || self.clear::<W>(first);
                if clear && matches!(self.then, Then::Check) {
                    for k in 0..4 {
                        let at = At::Beside(first + group * k);
                        let (x, u) = (W::load(x, at), W::load(u, at));
                        let to = W::choose(fourth, zero, x + u);
                        clear &= W::all(W::both(to.abs().below(most), W::choose(fourth, zero, u).abs().below(most)));
                    }
                }
                if clear {
                    for k in 0..4 {
                        let at = At::Beside(first + group * k);
                        let (from, by) = (W::load(x, at), W::load(u, at));
                        // The inverse mass stays.
                        W::choose(fourth, from, from + by).store(x, at);
                        if matches!(self.then, Then::Fall(_)) {
                            // Rounded as the plain code does it, product and sum.
                            W::choose(fourth, zero, W::choose(zero.below(from.last()), by * carry + gravity, zero)).store(u, at);
                        }
                    }
                } else {
                    self.moves.each(first..first + W::LANES, self.substep, self.then);
                }
            }
            first += W::LANES;
        }
        self.moves.each(first..self.vertices.end, self.substep, self.then);
    }
}

#[expect(unsafe_code, reason = "see Moves")]
impl Advance<'_> {
    /// Whether these vertices surely meet no body.
    #[inline(always)]
    unsafe fn clear<W: Wide>(&self, first: usize) -> bool {
        let Moves { x, u, .. } = *self.moves;
        // SAFETY: the caller's promise.
        let (place, by) = unsafe { (simd::vertices::<W>(x, first), simd::vertices::<W>(u, first)) };
        let travel = simd::dot(by, by);
        for body in self.moves.plan.bodies {
            let clear = Clear::of(body, self.substep, self.moves.plan.params.fraction);
            let [cx, cy, cz] = clear.center.to_array();
            let from = simd::sub(place, [W::splat(cx), W::splat(cy), W::splat(cz)]);
            let slow = travel.below(W::splat(clear.travel * clear.travel));
            let square = simd::dot(from, from);
            let outside = match clear.normal {
                None => W::splat(clear.reach * clear.reach).below(square),
                Some(normal) => {
                    let height = simd::dot(from, [W::splat(normal.x), W::splat(normal.y), W::splat(normal.z)]);
                    let sure = (square * W::splat(1e-8)).below(height * height);
                    W::both(sure, W::splat(clear.reach).below(height))
                }
            };
            if !W::all(W::both(slow, outside)) {
                return false;
            }
        }
        true
    }
}

/// Displacement of a vertex of inverse mass `w` that falls.
#[inline]
pub(crate) fn fallen(w: f32, u: Vec3A, ambient: Vec3A, substep: &Substep) -> Vec4 {
    let by = kernels::predict(u, ambient, substep).extend(0.0);
    if w == 0.0 { Vec4::ZERO } else { by }
}

/// Where a body cannot be met in a substep, told more cheaply than where it is.
#[derive(Debug, Clone, Copy)]
struct Clear {
    /// Vertices that move by less than this (m) ...
    travel: f32,
    /// ... and begin farther from here than `reach` (m), or for a plane above it along its normal, are clear.
    center: Vec3A,
    reach: f32,
    normal: Option<Vec3A>,
}

impl Clear {
    fn of(body: &Body, substep: &Substep, fraction: f32) -> Clear {
        let (a_travel, b_travel) = (Vec3A::from(body.a_travel), Vec3A::from(body.b_travel));
        let a = Vec3A::from(body.a) + a_travel * substep.start;
        let radius = body.radius.abs() + body.radius_travel.abs();
        if body.kind == PLANE {
            let travel = 0.1;
            let reach = 1.01 * (travel + a_travel.length() * fraction);
            return Clear { travel, center: a, reach, normal: Some(Vec3A::from(body.b)) };
        }
        let b = Vec3A::from(body.b) + b_travel * substep.start;
        let travel = 0.25 * radius;
        let step = a_travel.length().max(b_travel.length()) * fraction;
        // With a margin for what rounding makes of either, here and in the contact's own arithmetic.
        let reach = 1.01 * (0.5 * (b - a).length() + radius + travel + step);
        Clear { travel, center: (a + b) * 0.5, reach, normal: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::cloth::Cloth;
    use crate::simd::aligned::Lines;
    use crate::step::coefficients::Coefficients;
    use crate::step::plan::{Lists, Motion};
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
            let (mut lists, motion) = (Lists::default(), Motion { h, colliders: vec![before], ..Motion::default() });
            let plan = Plan::new(&cloth, &[], &options, &coefficients, &motion, 2, &attributes, &mut lists);
            let run = |breadth: Breadth| {
                let mut random = fastrand::Rng::with_seed(8);
                let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
                let (mut x, mut u) = (Lines::new(cloth.rest.len()), Lines::new(cloth.rest.len()));
                for (v, rest) in cloth.rest.iter().enumerate() {
                    x[v] = (rest.truncate() * far + vector(0.3)).extend(rest.w);
                    u[v] = vector(size).extend(0.0);
                }
                let (x, u, lost) = (x.share(), u.share(), AtomicUsize::new(usize::MAX));
                let moves = Moves { plan: &plan, x, u, good: [x, u], lost: &lost, breadth };
                moves.advance(&[0..37, 37..cloth.rest.len() as u32], &plan.substeps[0], Then::Fall(&plan.substeps[1]));
                #[expect(unsafe_code, reason = "one thread, both alive")]
                // SAFETY: nobody else is here.
                let state = |values: Shared<Vec4>| (0..values.len()).map(|v| unsafe { values.get(v) }.to_array()).collect();
                let both: [Vec<[f32; 4]>; 2] = [x, u].map(state);
                both
            };
            let one = run(Breadth::One);
            for (one, many) in Breadth::all().into_iter().map(run).flat_map(|many| one.clone().into_iter().zip(many)) {
                let same = |a: &[f32; 4], b: &[f32; 4]| a[..3].iter().zip(&b[..3]).all(|(a, b)| a == b);
                let first = one.iter().zip(&many).position(|(a, b)| !same(a, b));
                assert!(first.is_none(), "{:?} {far} {size}: vertex {first:?}", body.shape);
            }
        }
    }
}
