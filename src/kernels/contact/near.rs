//! Which bodies vertices may touch: cheap conservative tests.

use glam::{Vec3A, Vec4};

use super::Body;
use crate::kernels::integrate::xyz;
use crate::kernels::params::{Params, Substep};
use crate::simd::{Lanes, Vector};

/// With up to so many bodies, a test against the box around all vertices costs more than it saves.
const FEW: usize = 4;
/// Up to so many near bodies are tested with what is computed once for all vertices.
const MAX_NEAR: usize = 16;

/// A cheap conservative test: where vertices cannot touch a body in a substep, or in a whole step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clear {
    /// Vertices that move by less than this (m) cannot touch the body if they begin outside `reach`.
    travel: f32,
    /// Center of the bounding sphere; for a plane, a point of it.
    center: Vec3A,
    /// Radius of the bounding sphere (m).
    reach: f32,
    /// Normal of a plane and its displacement (m), none for other bodies.
    normal: Option<(Vec3A, Vec3A)>,
}

impl Clear {
    /// Clear nowhere: of a plane that turns, and in places that are not used.
    const NOWHERE: Clear = Clear { travel: 0.0, center: Vec3A::ZERO, reach: 0.0, normal: None };

    /// In any substep of a step.
    pub(crate) fn in_step(body: &Body) -> Clear {
        Clear::of(body, &Substep::default(), 1.0)
    }

    /// In a substep that is this `fraction` of the step.
    pub(crate) fn of(body: &Body, substep: &Substep, fraction: f32) -> Clear {
        let (a_travel, b_travel) = (Vec3A::from(body.a_travel), Vec3A::from(body.b_travel));
        let a = Vec3A::from(body.a) + a_travel * substep.start;
        let radius = body.radius.abs() + body.radius_travel.abs();
        if body.kind == super::PLANE && b_travel != Vec3A::ZERO {
            return Clear::NOWHERE;
        }
        if body.kind == super::PLANE {
            let step = a_travel * fraction;
            return Clear { travel: f32::INFINITY, center: a, reach: 0.0, normal: Some((Vec3A::from(body.b), step)) };
        }
        if body.kind == super::BOX {
            let radius = (Vec3A::from(body.b) + b_travel.max(Vec3A::ZERO)).length() + radius;
            let travel = 0.25 * radius;
            let reach = 1.01 * (radius + travel + a_travel.length() * fraction);
            return Clear { travel, center: a, reach, normal: None };
        }
        let radius = radius + (body.c[0] + body.c_travel[0].max(0.0)).max(0.0);
        let b = Vec3A::from(body.b) + b_travel * substep.start;
        let travel = 0.25 * radius;
        let step = a_travel.length().max(b_travel.length()) * fraction;
        // The factor 1.01 covers rounding errors, here and in the collision itself.
        let reach = 1.01 * (0.5 * (b - a).length() + radius + travel + step);
        Clear { travel, center: (a + b) * 0.5, reach, normal: None }
    }

    /// A mask of the vertices at `x` (m), moving by `u` (m), that surely do not touch the body.
    #[inline(always)]
    pub(crate) fn of_vertices<L: Lanes>(&self, x: Vector<L>, u: Vector<L>) -> L::Mask {
        let from = x - Vector::splat(self.center.to_array());
        let slow = u.dot(u).lt(L::splat(self.travel * self.travel));
        let square = from.dot(from);
        let outside = match self.normal {
            None => L::splat(self.reach * self.reach).lt(square),
            // The height afterwards, where it is not a rounding error.
            Some((normal, step)) => {
                let by = u - Vector::splat(step.to_array());
                let height = (from + by).dot(Vector::splat(normal.to_array()));
                let sure = ((square + by.dot(by)) * L::splat(1e-8)).lt(height * height);
                L::and(sure, L::splat(0.0).lt(height))
            }
        };
        L::and(slow, outside)
    }

    /// Whether vertices within this range surely do not touch the body, which is no plane.
    fn of_all(&self, range: &MotionRange) -> bool {
        let apart = (range.low - self.center).max(self.center - range.high).max(Vec3A::ZERO);
        self.normal.is_none() && range.fastest < self.travel && self.reach < apart.length()
    }
}

/// A box in which vertices begin a substep (m), and a bound on how far they are about to move in it (m).
#[derive(Debug, Clone, Copy)]
struct MotionRange {
    low: Vec3A,
    high: Vec3A,
    fastest: f32,
}

impl MotionRange {
    const ANYWHERE: MotionRange = MotionRange { low: Vec3A::NEG_INFINITY, high: Vec3A::INFINITY, fastest: f32::INFINITY };

    /// The range of a state, with room for what bodies usually change.
    fn around(state: impl Iterator<Item = [Vec4; 2]>, h: f32) -> MotionRange {
        let none = (Vec4::INFINITY, Vec4::NEG_INFINITY, Vec4::ZERO);
        let (low, high, most) = state.fold(none, |(low, high, most), [x, u]| (low.min(x), high.max(x), most.max(u.abs())));
        let fastest = xyz(most).length();
        let room = fastest + super::DEPENETRATION * h;
        MotionRange { low: xyz(low) - room, high: xyz(high) + room, fastest: fastest + room }
    }
}

/// The bodies that some vertices may touch in a substep, in order.
pub(crate) struct NearBodies<'a> {
    bodies: &'a [Body],
    in_step: &'a [Clear],
    /// The others are clear of vertices in this range.
    range: MotionRange,
    /// Indices of the first near bodies, with their tests in this substep.
    first: [(u32, Clear); MAX_NEAR],
    count: usize,
    /// From this index on bodies may be near, too.
    rest: usize,
}

impl<'a> NearBodies<'a> {
    /// No bodies.
    pub(crate) const NONE: NearBodies<'static> = NearBodies {
        bodies: &[],
        in_step: &[],
        range: MotionRange::ANYWHERE,
        first: [(0, Clear::NOWHERE); MAX_NEAR],
        count: 0,
        rest: 0,
    };

    /// Of the bodies, of each of which `in_step` says where it cannot be touched in the step, those near vertices in some `state`:
    /// positions and displacements (m).
    pub(crate) fn of(
        bodies: &'a [Body],
        in_step: &'a [Clear],
        substep: &Substep,
        params: &Params,
        state: impl Iterator<Item = [Vec4; 2]>,
    ) -> NearBodies<'a> {
        let range = if bodies.len() > FEW { MotionRange::around(state, params.h) } else { MotionRange::ANYWHERE };
        let mut near = NearBodies { bodies, in_step, range, rest: bodies.len(), ..NearBodies::NONE };
        for (index, body) in bodies.iter().enumerate() {
            if in_step[index].of_all(&range) {
                continue;
            }
            if near.count == MAX_NEAR {
                near.rest = index;
                break;
            }
            near.first[near.count] = (index as u32, Clear::of(body, substep, params.fraction));
            near.count += 1;
        }
        near
    }

    /// Visits the near bodies.
    #[inline(always)]
    pub(crate) fn visit<'n>(&'n self, substep: &'n Substep, params: &'n Params) -> Visit<'n, 'a> {
        Visit { near: self, substep, params, place: 0, next: 0, visits_all: false }
    }

    /// Whether bodies that are not near are still clear of vertices, after others have changed their state.
    #[inline(always)]
    pub(crate) fn holds<L: Lanes>(&self, x: Vector<L>, u: Vector<L>) -> bool {
        let MotionRange { low, high, fastest } = self.range;
        let within = |x: L, low: f32, high: f32| L::and(L::splat(low).lt(x), x.lt(L::splat(high)));
        let is_inside = L::and(within(x.x, low.x, high.x), L::and(within(x.y, low.y, high.y), within(x.z, low.z, high.z)));
        L::all(L::and(is_inside, u.dot(u).lt(L::splat(fastest * fastest))))
    }
}

/// Visits near bodies in order, each with its test in the substep.
pub(crate) struct Visit<'n, 'a> {
    near: &'n NearBodies<'a>,
    substep: &'n Substep,
    params: &'n Params,
    /// How many of the first ones were visited, and the index after the last body.
    place: usize,
    next: usize,
    visits_all: bool,
}

impl Visit<'_, '_> {
    /// Visits all bodies from here on, near or not, because a body has moved vertices out of the range for which that is known. So it
    /// does not matter which vertices are tested together.
    #[inline(always)]
    pub(crate) fn visit_all(&mut self) {
        self.visits_all = true;
    }
}

impl<'a> Iterator for Visit<'_, 'a> {
    type Item = (&'a Body, Clear);

    #[inline(always)]
    fn next(&mut self) -> Option<(&'a Body, Clear)> {
        let NearBodies { bodies, in_step, range, ref first, count, rest } = *self.near;
        if !self.visits_all {
            if self.place < count {
                let (index, clear) = first[self.place];
                (self.place, self.next) = (self.place + 1, index as usize + 1);
                return Some((&bodies[index as usize], clear));
            }
            self.next = self.next.max(rest);
        }
        while let Some(body) = bodies.get(self.next) {
            self.next += 1;
            if self.visits_all || !in_step[self.next - 1].of_all(&range) {
                return Some((body, Clear::of(body, self.substep, self.params.fraction)));
            }
        }
        None
    }
}
