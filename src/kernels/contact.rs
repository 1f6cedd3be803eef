//! Collision of a vertex with an analytic collider. Scalar code, because few vertices are close to a collider.

use bytemuck::{Pod, Zeroable};
use glam::Vec3A;

use rounded_box::contact_box;

use super::distance::MIN_LENGTH;
use super::params::{Params, Substep};
use crate::simd::{Lanes, Vector};

mod rounded_box;

/// A collider during one step, in local coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Body {
    /// Plane: a point of it. Round body: one end of the axis (a sphere's center). Box: its center. All at the step's
    /// start.
    pub a: [f32; 3],
    /// Round body: the radius at `a`. Box: the radius of its rounded edges, by which it extends beyond its core.
    pub radius: f32,
    /// Plane: its unit normal. Round body: the other end of the axis. Box: the half extents of its core, along its own
    /// axes.
    pub b: [f32; 3],
    pub friction: f32,
    /// Change of `a` over the step.
    pub a_travel: [f32; 3],
    /// Change of `radius` over the step.
    pub radius_travel: f32,
    /// Change of `b` over the step; 0 for a plane, whose normal is that at the step's end.
    pub b_travel: [f32; 3],
    /// [`PLANE`], [`ROUND`] or [`BOX`].
    pub kind: u32,
    /// Round body: by how much the radius at `b` is larger than at `a`, then three unused numbers. Box: its rotation, a
    /// quaternion that has unit length at the step's start and end.
    pub c: [f32; 4],
    /// Change of `c` over the step.
    pub c_travel: [f32; 4],
}

/// Values of [`Body::kind`].
pub(crate) const PLANE: u32 = 0;
pub(crate) const ROUND: u32 = 1;
pub(crate) const BOX: u32 = 2;

/// Speed (m/s) at which a vertex that began a substep inside a body is pushed out.
pub(crate) const DEPENETRATION: f32 = 1.0;
/// A vertex that moves in a substep by more than this share of a body's radius, or of half a box's thickness, is tested
/// along its path (continuous collision detection).
pub(crate) const SWEPT: f32 = 0.25;
/// Maximum number of steps along a path.
pub(crate) const SWEEP_STEPS: u32 = 24;

/// Resolves the collision of a vertex at `x` that is about to move by `u` with one body. Returns `(x, u)` afterwards.
///
/// The gap is computed from displacements, so that its rounding error is relative to `u`, not to `x`. Computed from
/// positions it would lose part of `h² g` at hundreds of substeps, and with it part of the friction (0.4 % of the
/// acceleration at 16.9 degrees, friction 0.3, 320 substeps, one meter from the origin; more farther out). The depth at
/// which the vertex already was inside is removed from `x` at a bounded speed, which adds no velocity. The remaining
/// depth is removed from `u`, and Coulomb friction, relative to the body's motion, is proportional to it. The path of a
/// fast vertex is tested for the first touch.
#[inline]
pub(crate) fn contact_body(x: Vec3A, u: Vec3A, body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
    match body.kind {
        PLANE => {
            let (a, a_step) = axis_end(body, substep, params);
            let n = Vec3A::from(body.b);
            let before = n.dot(x - a);
            let after = before + n.dot(u - a_step);
            respond(x, u, n, before, after, a_step, body.friction, params.h)
        }
        BOX => contact_box(x, u, body, substep, params),
        _ => contact_round(x, u, body, substep, params),
    }
}

/// [`Body::a`] at the start of a substep, and its displacement.
#[inline]
fn axis_end(body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
    let travel = Vec3A::from(body.a_travel);
    (Vec3A::from(body.a) + travel * substep.start, travel * params.fraction)
}

/// [`contact_body`] for a sphere or a capsule.
fn contact_round(x: Vec3A, u: Vec3A, body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
    let (a, a_step) = axis_end(body, substep, params);
    let b = Vec3A::from(body.b) + Vec3A::from(body.b_travel) * substep.start;
    let b_step = Vec3A::from(body.b_travel) * params.fraction;
    let (taper, taper_step) = (body.c[0] + body.c_travel[0] * substep.start, body.c_travel[0] * params.fraction);
    let t = nearest(a + a_step, b + b_step, taper + taper_step, x + u);
    let radius_a = body.radius + body.radius_travel * substep.start;
    let radius = radius_a + taper * t;
    let growth = body.radius_travel * params.fraction + taper_step * t;
    let step = a_step + (b_step - a_step) * t;
    let d0 = x - (a + (b - a) * t);
    let du = u - step;
    let d = d0 + du;
    let start = d0.length();
    let end = d.length();
    let before = start - radius;
    let travel2 = du.length_squared();
    // A vertex at rest on the surface may be inside by a rounding error.
    if before > -SWEPT * radius
        && travel2 > SWEPT * SWEPT * radius * radius
        && let Some((n, after)) = swept(x, du, a, b, radius_a, taper, travel2.sqrt())
    {
        return respond(x, u, n, before, after - growth, step, body.friction, params.h);
    }
    let after = before + (2.0 * d0.dot(du) + travel2) / (start + end).max(1e-20) - growth;
    let n = if end > MIN_LENGTH { d / end } else { Vec3A::Y };
    respond(x, u, n, before, after, step, body.friction, params.h)
}

/// Parameter, from 0 at `a` to 1 at `b`, of that ball of a round body whose surface is nearest to `x`. The body is the
/// union of balls along the axis, with a radius larger by `taper` at `b`. On a cone the normal is inclined to the
/// perpendicular of the axis by an angle of sine `taper / |b - a|`.
fn nearest(a: Vec3A, b: Vec3A, taper: f32, x: Vec3A) -> f32 {
    let axis = b - a;
    let square = axis.length_squared();
    let along = (x - a).dot(axis) / square.max(1e-20);
    if taper == 0.0 {
        return along.clamp(0.0, 1.0);
    }
    let cone = square - taper * taper;
    if cone <= 0.0 {
        // The larger ball contains the smaller one.
        return if taper > 0.0 { 1.0 } else { 0.0 };
    }
    let across = (x - a - axis * along).length();
    (along + across * taper / (cone * square).sqrt()).clamp(0.0, 1.0)
}

/// The first touch of the path `x + s du` with a round body: the normal there, and the gap between the path's end and
/// the tangent plane. Steps along the path by the distance to the surface (sphere tracing: Hart 1996), which never
/// passes through it.
fn swept(x: Vec3A, du: Vec3A, a: Vec3A, b: Vec3A, radius: f32, taper: f32, travel: f32) -> Option<(Vec3A, f32)> {
    let mut s = 0.0;
    for _ in 0..SWEEP_STEPS {
        let at = x + du * s;
        let t = nearest(a, b, taper, at);
        let d = at - (a + (b - a) * t);
        let distance = d.length();
        let radius = radius + taper * t;
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

/// Pushes a vertex out along `n`, given its signed gap before and after the substep, and applies friction. Returns
/// `(x, u)` afterwards.
#[inline]
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

/// A cheap conservative test: where vertices cannot touch a body in a substep.
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
    pub(crate) fn of(body: &Body, substep: &Substep, fraction: f32) -> Clear {
        let (a_travel, b_travel) = (Vec3A::from(body.a_travel), Vec3A::from(body.b_travel));
        let a = Vec3A::from(body.a) + a_travel * substep.start;
        let radius = body.radius.abs() + body.radius_travel.abs();
        if body.kind == PLANE {
            let step = a_travel * fraction;
            return Clear { travel: f32::INFINITY, center: a, reach: 0.0, normal: Some((Vec3A::from(body.b), step)) };
        }
        if body.kind == BOX {
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
}

#[cfg(test)]
#[path = "../../tests/unit/kernels_contact.rs"]
mod tests;
