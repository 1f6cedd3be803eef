//! Collision of a vertex with a rounded box that moves and rotates; in `shaders/contact.wgsl` with the other shapes.

use glam::{Vec3A, Vec4, Vec4Swizzles};

use super::{Body, SWEEP_STEPS, SWEPT, respond};
use crate::kernels::distance::MIN_LENGTH;
use crate::kernels::params::{Params, Substep};

/// [`contact_body`](super::contact_body) for a box that moves and rotates, computed in the frame of the box.
///
/// The quaternion is interpolated linearly over the step. The rotation in a substep is computed from the quaternions'
/// difference, as the vector `g` along the axis with length `tan(angle/2)`. The box's displacement under the vertex,
/// `2 (g x r + g x (g x r)) / (1 + g²)`, then has a rounding error relative to itself, not to the position.
pub(super) fn contact_box(x: Vec3A, u: Vec3A, body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
    let arm = x - (Vec3A::from(body.a) + Vec3A::from(body.a_travel) * substep.start);
    let rotation = Vec4::from(body.c) + Vec4::from(body.c_travel) * substep.start;
    let change = Vec4::from(body.c_travel) * params.fraction;
    let g = turn(rotation, change);
    let across = g.cross(arm);
    let step = Vec3A::from(body.a_travel) * params.fraction + (across + g.cross(across)) * (2.0 / (1.0 + g.dot(g)));
    let ends = (rotation + change).normalize();
    let y = turned_back(rotation.normalize(), arm);
    let dy = turned_back(ends, u - step);

    let core = Vec3A::from(body.b) + Vec3A::from(body.b_travel) * substep.start;
    let core_step = Vec3A::from(body.b_travel) * params.fraction;
    let radius = body.radius + body.radius_travel * substep.start;
    let growth = body.radius_travel * params.fraction;
    let (_, before) = box_gap(y, core, radius);
    let thin = SWEPT * (core.min_element() + radius);
    let travel2 = dy.length_squared();
    let touch = if before > -thin && travel2 > thin * thin { swept_box(y, dy, core, radius, travel2.sqrt()) } else { None };
    let (n, after) = touch.unwrap_or_else(|| box_end(y, dy, core, core_step, radius));
    respond(x, u, turned(ends, n), before, after - growth, step, body.friction, params.h)
}

/// The point of a box's surface nearest to the end of the path from `y` by `dy`: the normal there, and the gap computed
/// from displacements. A point beyond one face only is nearest to that face, a point beyond several to their common
/// edge or corner.
fn box_end(y: Vec3A, dy: Vec3A, core: Vec3A, core_step: Vec3A, radius: f32) -> (Vec3A, f32) {
    let side = toward(y + dy);
    let beyond = (y + dy).abs() - (core + core_step);
    let outside = positive(beyond);
    let d0 = outside * (y - side * core);
    let dd = outside * (dy - side * core_step);
    let (start, end) = (d0.length(), (d0 + dd).length());
    if outside.element_sum() > 1.0 && end > MIN_LENGTH {
        return ((d0 + dd) / end, start - radius + (2.0 * d0.dot(dd) + dd.dot(dd)) / (start + end));
    }
    let axis = farthest(beyond);
    let n = side * axis;
    (n, (n.dot(y) - axis.dot(core)) - radius + n.dot(dy) - axis.dot(core_step))
}

/// The first touch of the path `y + s dy` with a box at rest; see [`swept`].
fn swept_box(y: Vec3A, dy: Vec3A, core: Vec3A, radius: f32, travel: f32) -> Option<(Vec3A, f32)> {
    let touching = 0.001 * (core.min_element() + radius);
    let mut s = 0.0;
    for _ in 0..SWEEP_STEPS {
        let (n, gap) = box_gap(y + dy * s, core, radius);
        if gap < touching {
            return Some((n, gap + n.dot(dy) * (1.0 - s)));
        }
        s += gap / travel;
        if s >= 1.0 {
            return None;
        }
    }
    None
}

/// Normal and signed distance of the surface of a box at rest at its point nearest to `y`.
fn box_gap(y: Vec3A, core: Vec3A, radius: f32) -> (Vec3A, f32) {
    let (side, beyond) = (toward(y), y.abs() - core);
    let outside = positive(beyond);
    let d = outside * beyond;
    let length = d.length();
    if outside.element_sum() > 1.0 && length > MIN_LENGTH {
        return (side * d / length, length - radius);
    }
    let axis = farthest(beyond);
    (side * axis, axis.dot(beyond) - radius)
}

/// The axis with the largest component; the first of equal ones.
fn farthest(v: Vec3A) -> Vec3A {
    match (v.x >= v.y && v.x >= v.z, v.y >= v.z) {
        (true, _) => Vec3A::X,
        (false, true) => Vec3A::Y,
        (false, false) => Vec3A::Z,
    }
}

/// For each axis 1 or -1, the sign of the side that `y` is on.
fn toward(y: Vec3A) -> Vec3A {
    Vec3A::select(y.cmplt(Vec3A::ZERO), Vec3A::NEG_ONE, Vec3A::ONE)
}

/// 1 for each positive component, 0 for the others.
fn positive(v: Vec3A) -> Vec3A {
    Vec3A::select(v.cmpgt(Vec3A::ZERO), Vec3A::ONE, Vec3A::ZERO)
}

/// The rotation vector, along the axis with length `tan(angle/2)`, from a quaternion to one that differs by `change`.
/// Neither needs unit length.
fn turn(rotation: Vec4, change: Vec4) -> Vec3A {
    let (from, by) = (Vec3A::from_vec4(rotation), Vec3A::from_vec4(change));
    let axis = by * rotation.w - from * change.w - by.cross(from);
    axis / (rotation.dot(rotation) + rotation.dot(change))
}

/// Rotates a vector by a unit quaternion.
fn turned(rotation: Vec4, v: Vec3A) -> Vec3A {
    let axis = Vec3A::from_vec4(rotation);
    let across = axis.cross(v) * 2.0;
    v + across * rotation.w + axis.cross(across)
}

/// Rotates a vector by the inverse of a unit quaternion.
fn turned_back(rotation: Vec4, v: Vec3A) -> Vec3A {
    turned((-rotation.xyz()).extend(rotation.w), v)
}
