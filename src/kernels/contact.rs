//! Contact of a vertex with a body. One vertex at a time: few are near one.

use bytemuck::{Pod, Zeroable};
use glam::Vec3A;

use super::distance::LEAST_LENGTH;
use super::params::{Params, Substep};
use crate::simd::{Lanes, Vector};

/// A collider during one step, in local coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Body {
    /// Plane: a point of it. Round: one end of the axis (a sphere's center), at the step's start.
    pub a: [f32; 3],
    pub radius: f32,
    /// Plane: its unit normal. Round: the other end of the axis.
    pub b: [f32; 3],
    pub friction: f32,
    /// How `a`, `radius` and a round body's `b` change over the step.
    pub a_travel: [f32; 3],
    pub radius_travel: f32,
    pub b_travel: [f32; 3],
    /// [`PLANE`] or [`ROUND`].
    pub kind: u32,
}

pub(crate) const PLANE: u32 = 0;
pub(crate) const ROUND: u32 = 1;

/// Speed (m/s) at which a vertex that began a substep inside a body is moved out of it.
pub(crate) const DEPENETRATION: f32 = 1.0;
/// A vertex that moves by more than this share of a body's radius in a substep is swept along its path.
pub(crate) const SWEPT: f32 = 0.25;
pub(crate) const SWEEP_STEPS: u32 = 24;

/// Contact of a vertex at `x` about to move by `u` with one body: `(x, u)` afterwards.
///
/// The gap is formed in displacements, so that it is right to the last bit of `u`, not of `x`: formed in positions it loses
/// part of `h² g` to rounding at hundreds of substeps, and with it part of friction (0.4 % of the acceleration at 16.9
/// degrees and friction 0.3, 320 substeps, a meter from the origin; more farther out). What the vertex was already
/// inside by is taken out of `x` at a bounded speed and gives it no velocity; the rest is taken out of `u`, and is what
/// friction (Coulomb, relative to the body's own motion) is measured by. A fast vertex is swept along its path.
pub(crate) fn contact_body(x: Vec3A, u: Vec3A, body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
    let a = Vec3A::from(body.a) + Vec3A::from(body.a_travel) * substep.start;
    let a_step = Vec3A::from(body.a_travel) * params.fraction;
    if body.kind == PLANE {
        let n = Vec3A::from(body.b);
        let before = n.dot(x - a);
        let after = before + n.dot(u - a_step);
        return respond(x, u, n, before, after, a_step, body.friction, params.h);
    }
    let b = Vec3A::from(body.b) + Vec3A::from(body.b_travel) * substep.start;
    let b_step = Vec3A::from(body.b_travel) * params.fraction;
    let radius = body.radius + body.radius_travel * substep.start;
    let t = nearest(a + a_step, b + b_step, x + u);
    let step = a_step + (b_step - a_step) * t;
    let d0 = x - (a + (b - a) * t);
    let du = u - step;
    let d = d0 + du;
    let start = d0.length();
    let end = d.length();
    let before = start - radius;
    let travel2 = du.length_squared();
    // A vertex at rest on the surface may be inside it by a rounding.
    if before > -SWEPT * radius
        && travel2 > SWEPT * SWEPT * radius * radius
        && let Some((n, after)) = swept(x, du, a, b, radius, travel2.sqrt())
    {
        return respond(x, u, n, before, after - body.radius_travel * params.fraction, step, body.friction, params.h);
    }
    let after = before + (2.0 * d0.dot(du) + travel2) / (start + end).max(1e-20) - body.radius_travel * params.fraction;
    let n = if end > LEAST_LENGTH { d / end } else { Vec3A::Y };
    respond(x, u, n, before, after, step, body.friction, params.h)
}

/// Where on the segment from `a` (0) to `b` (1) lies the point nearest to `x`.
fn nearest(a: Vec3A, b: Vec3A, x: Vec3A) -> f32 {
    let axis = b - a;
    ((x - a).dot(axis) / axis.length_squared().max(1e-20)).clamp(0.0, 1.0)
}

/// First touch of the path `x + s du` with a round body: its normal there, and the gap that the end of the path leaves to
/// the tangent plane. Steps by the distance still free (sphere tracing: Hart 1996), which never passes the surface.
fn swept(x: Vec3A, du: Vec3A, a: Vec3A, b: Vec3A, radius: f32, travel: f32) -> Option<(Vec3A, f32)> {
    let mut s = 0.0;
    for _ in 0..SWEEP_STEPS {
        let at = x + du * s;
        let d = at - (a + (b - a) * nearest(a, b, at));
        let distance = d.length();
        if distance < radius * 1.001 {
            let n = d / distance.max(1e-20);
            return Some((n, distance - radius + n.dot(du) * (1.0 - s)));
        }
        s += (distance - radius) / travel;
        if s >= 1.0 {
            return None;
        }
    }
    None
}

/// Pushes a vertex out along `n` given its signed gap before and after the substep, with friction: `(x, u)` afterwards.
#[expect(clippy::too_many_arguments, reason = "a contact has this many numbers; the shader's twin takes the same")]
fn respond(x: Vec3A, u: Vec3A, n: Vec3A, before: f32, after: f32, step: Vec3A, friction: f32, h: f32) -> (Vec3A, Vec3A) {
    if after >= 0.0 {
        return (x, u);
    }
    let depth = -after;
    let old = depth.min((-before).max(0.0));
    let push = depth - old;
    let u = u + n * push;
    let relative = u - step;
    let slip = relative - n * n.dot(relative);
    let length = slip.length();
    let u = u - slip * (friction * push / length.max(1e-30)).min(1.0);
    (x + n * old.min(DEPENETRATION * h), u)
}

/// Where a body cannot be met in a substep, told more cheaply than where it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clear {
    /// Vertices that move by less than this (m) ...
    travel: f32,
    /// ... and begin farther from here than `reach` (m), or for a plane above it along its normal, are clear.
    center: Vec3A,
    reach: f32,
    normal: Option<Vec3A>,
}

impl Clear {
    pub(crate) fn of(body: &Body, substep: &Substep, fraction: f32) -> Clear {
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

    /// Where vertices at `x` (m) that move by `u` (m) surely do not meet the body.
    #[inline(always)]
    pub(crate) fn of_vertices<L: Lanes>(&self, x: Vector<L>, u: Vector<L>) -> L::Mask {
        let from = x - Vector::splat(self.center.to_array());
        let slow = u.dot(u).lt(L::splat(self.travel * self.travel));
        let square = from.dot(from);
        let outside = match self.normal {
            None => L::splat(self.reach * self.reach).lt(square),
            Some(normal) => {
                let height = from.dot(Vector::splat(normal.to_array()));
                let sure = (square * L::splat(1e-8)).lt(height * height);
                L::and(sure, L::splat(self.reach).lt(height))
            }
        };
        L::and(slow, outside)
    }
}
