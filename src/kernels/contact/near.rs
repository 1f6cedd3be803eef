//! Which bodies vertices may touch: cheap conservative tests.

use glam::{Vec3A, Vec4};

use super::Body;
use crate::kernels::integrate::xyz;
use crate::kernels::params::{Params, Substep};
use crate::simd::{Lanes, Vector};

/// Up to so many bodies are tested against each vertex, without a test against all vertices together.
const FEW: usize = 4;
/// Up to so many near bodies are tested with what is computed once for all vertices.
const MOST: usize = 16;

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
    /// Nothing is known.
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

/// The box that vertices begin a substep in (m), and a bound on how far they are about to move (m).
#[derive(Debug, Clone, Copy)]
struct MotionRange {
    low: Vec3A,
    high: Vec3A,
    fastest: f32,
}

impl MotionRange {
    fn of(state: impl Iterator<Item = [Vec4; 2]>) -> MotionRange {
        let none = (Vec4::INFINITY, Vec4::NEG_INFINITY, Vec4::ZERO);
        let (low, high, most) = state.fold(none, |(low, high, most), [x, u]| (low.min(x), high.max(x), most.max(u.abs())));
        MotionRange { low: xyz(low), high: xyz(high), fastest: xyz(most).length() }
    }
}

/// The bodies that some vertices may touch in a substep, in order.
#[derive(Debug)]
pub(crate) struct NearBodies<'a> {
    bodies: &'a [Body],
    /// Indices of the first of them, with their tests in this substep.
    first: [(u32, Clear); MOST],
    count: usize,
    /// The bodies from this index on may be near, too.
    rest: usize,
}

impl<'a> NearBodies<'a> {
    /// No bodies.
    pub(crate) const NONE: NearBodies<'static> =
        NearBodies { bodies: &[], first: [(0, Clear::NOWHERE); MOST], count: 0, rest: 0 };

    /// Of the bodies, of each of which `in_step` says where it cannot be touched in the step, those near vertices in some `state`:
    /// positions and displacements (m).
    pub(crate) fn of(
        bodies: &'a [Body],
        in_step: &[Clear],
        substep: &Substep,
        params: &Params,
        state: impl Iterator<Item = [Vec4; 2]>,
    ) -> NearBodies<'a> {
        let mut near = NearBodies { bodies, rest: bodies.len(), ..NearBodies::NONE };
        let range = (bodies.len() > FEW).then(|| MotionRange::of(state));
        for (index, body) in bodies.iter().enumerate() {
            if range.is_some_and(|range| in_step[index].of_all(&range)) {
                continue;
            }
            if near.count == MOST {
                near.rest = index;
                break;
            }
            near.first[near.count] = (index as u32, Clear::of(body, substep, params.fraction));
            near.count += 1;
        }
        near
    }

    /// The bodies with their tests in this substep.
    #[inline(always)]
    pub(crate) fn iter(&self, substep: &Substep, params: &Params) -> impl Iterator<Item = (&'a Body, Clear)> {
        let first = self.first[..self.count].iter().map(|&(index, clear)| (&self.bodies[index as usize], clear));
        first.chain(self.bodies[self.rest..].iter().map(|body| (body, Clear::of(body, substep, params.fraction))))
    }
}
