//! Collision of vertices with a rounded box that moves and rotates; in `shaders/contact.wgsl` with the other shapes.

use glam::{Quat, Vec3A, Vec4, Vec4Swizzles};

use super::{Body, ContactPoint, Gap, SWEPT, Solid, TOUCHING, splat, swept};
use crate::kernels::distance::MIN_LENGTH;
use crate::kernels::params::{Params, Substep};
use crate::simd::{Lanes, Vector};

/// A vertex lies on a face if it is within this share of the coordinates of its plane: sixteen rounding errors.
pub(crate) const ROUNDING: f32 = 1.0 / 1_048_576.0;
/// It is pressed on a face if it moves into it by more than this share of its way.
pub(crate) const PRESSED: f32 = 1e-5;
/// By how many of the ways of a vertex the rank of a face is raised (`entered`): it ended less than one of them inside.
pub(crate) const WAS_OUTSIDE: f32 = 8.0;
pub(crate) const SLID: f32 = 4.0;
pub(crate) const CARRIES: f32 = 2.0;

/// Computed in the frame of the box.
///
/// The quaternion is interpolated linearly over the step. The rotation in a substep is computed from the quaternions'
/// difference, as the vector `g` along the axis with length `tan(angle/2)`. The box's displacement under the vertex,
/// `2 (g x r + g x (g x r)) / (1 + g²)`, then has a rounding error relative to itself, not to the position.
#[inline(always)]
pub(super) fn contact_box<L: Lanes>(
    x: Vector<L>,
    u: Vector<L>,
    body: &Body,
    substep: &Substep,
    params: &Params,
) -> ContactPoint<L> {
    let arm = x - splat(Vec3A::from(body.a) + Vec3A::from(body.a_travel) * substep.start);
    let rotation = Vec4::from(body.c) + Vec4::from(body.c_travel) * substep.start;
    let change = Vec4::from(body.c_travel) * params.fraction;
    let g = turn(rotation, change);
    let across = splat::<L>(g).cross(arm);
    let turned_by = (across + splat::<L>(g).cross(across)) * L::splat(2.0 / (1.0 + g.dot(g)));
    let step = splat::<L>(Vec3A::from(body.a_travel) * params.fraction) + turned_by;
    let ends = (rotation + change).normalize();
    let y = turned_back(rotation.normalize(), arm);
    let dy = turned_back(ends, u - step);

    let core = Vec3A::from(body.b) + Vec3A::from(body.b_travel) * substep.start;
    let core_step = Vec3A::from(body.b_travel) * params.fraction;
    let radius = body.radius + body.radius_travel * substep.start;
    let growth = body.radius_travel * params.fraction;
    let shape = RoundedBox { core, radius };
    let before = shape.gap(y).distance;
    let size = Vec3A::from(body.a).abs().max_element() + core.max_element() + radius;
    let ground = Ground { up: Quat::from_vec4(ends).inverse() * Vec3A::from(params.up), rounding: ROUNDING * size };
    let (mut n, mut after, slides) = box_end(y, dy, core, core_step, radius, &ground);
    let thin = SWEPT * (core.min_element() + radius);
    let travel2 = dy.dot(dy);
    let is_fast = L::and(L::splat(-thin).lt(before), L::splat(thin * thin).lt(travel2));
    if L::any(is_fast) {
        let touch = swept(y, dy, travel2.sqrt(), is_fast, shape);
        n = Vector::select(touch.hit, Vector::select(slides, n, touch.n), n);
        after = L::select(touch.hit, L::select(slides, after, touch.after), after);
    }
    let grip = grip(y + dy, core + core_step, radius, body.slick);
    ContactPoint { n: turned(ends, n), before, after: after - L::splat(growth), step, grip }
}

/// The share of the friction at `end`: it fades toward an edge whose radius is less than `slick`.
///
/// An edge of the cloth that passes over a sharp edge cuts through the corner. Its tension pulls the vertex that is still on the
/// side nearly perpendicularly into it, instead of along the surface and around a corner, and with `mu` of that as friction the
/// vertex is stuck until the cloth has stretched by several times its length. A vertex at the distance `s` from the edge is pulled
/// along the side by `s` for every `l` into it, `l` the length of the cloth's edge, so it slides if friction is below `s/l`: at any
/// distance if friction is `mu s/slick`, with `mu` below `slick/l`.
#[inline(always)]
fn grip<L: Lanes>(end: Vector<L>, core: Vec3A, radius: f32, slick: f32) -> L {
    let beyond = end.abs() - splat(core);
    let second = beyond.x.min(beyond.y).max(beyond.x.max(beyond.y).min(beyond.z));
    let from_edge = L::splat(radius) - second.min(L::splat(0.0));
    (from_edge * L::splat(1.0 / slick.max(MIN_LENGTH))).min(L::splat(1.0))
}

/// The point of a box's surface nearest to the end of the path from `y` by `dy`: the normal there, the gap computed from
/// displacements, and a mask of what slides on a face. A point beyond one face only is nearest to that face, a point beyond
/// several to their common edge or corner. What ends in the core is held by the face through which it [`entered`].
#[inline(always)]
fn box_end<L: Lanes>(
    y: Vector<L>,
    dy: Vector<L>,
    core: Vec3A,
    core_step: Vec3A,
    radius: f32,
    ground: &Ground,
) -> (Vector<L>, L, L::Mask) {
    let end = y + dy;
    let side = toward(end);
    let beyond = end.abs() - splat(core + core_step);
    let outside = positive(beyond);
    let d0 = outside.times(y - side.times(splat(core)));
    let dd = outside.times(dy - side.times(splat(core_step)));
    let d = d0 + dd;
    let (start, length) = (d0.length(), d.length());
    let grown = d0.dot(dd).mul_add(L::splat(2.0), dd.dot(dd)) / (start + length);
    let is_inside = (outside.x + outside.y + outside.z).lt(L::splat(1.0));
    let (mut axis, mut slides) = (farthest(beyond), is_inside);
    if L::any(is_inside) {
        let start = side.times(y) - splat(core + radius);
        let (through, is_along) = entered(start, side.times(dy) - splat(core_step), beyond, side, ground);
        axis = Vector::select(is_inside, through, axis);
        slides = L::and(is_inside, is_along);
    }
    let n = side.times(axis);
    let at_face = (n.dot(y) - axis.dot(splat(core))) - L::splat(radius) + n.dot(dy) - axis.dot(splat(core_step));
    let is_edge = is_edge(outside, length);
    (Vector::select(is_edge, d.over(length), n), L::select(is_edge, start - L::splat(radius) + grown, at_face), slides)
}

/// What tells a face on which cloth lies from one that another box hides.
struct Ground {
    /// The direction opposite to gravity, in the frame of the box; 0 without gravity.
    up: Vec3A,
    /// A vertex so far (m) inside a face's plane may lie on it.
    rounding: f32,
}

/// The axis of the face that holds points which end in the core, and a mask of those that slid along it. `start` is by how
/// much (m) they began beyond each face's plane, `away` by how much they moved away from the core, `beyond` the gap at the end.
///
/// The nearest face is the wrong one beside the hidden face between two boxes whose tops are level: a vertex that has sunk by
/// `g h²`, and is across the seam by less, would be pushed back. So only faces count whose planes the vertex was not inside of.
/// Of these a face along which it slid, pressed on it, goes before those that it passed on the way; then the one that carries
/// against gravity, since level seams are found in floors; then the nearest one. What began inside is nearest to its face. So is
/// cloth that is pulled back over an edge: its tension cuts through the corner, and takes it toward the face from below.
#[inline(always)]
fn entered<L: Lanes>(
    start: Vector<L>,
    away: Vector<L>,
    beyond: Vector<L>,
    side: Vector<L>,
    ground: &Ground,
) -> (Vector<L>, L::Mask) {
    let (zero, rounding) = (L::splat(0.0), L::splat(ground.rounding));
    let way = away.length();
    let pressed = way * L::splat(-PRESSED);
    let (nearest, up) = (farthest(beyond), side.times(splat(ground.up)));
    let ranks = Vector::new(
        rank(start.x, away.x, beyond.x, up.x, nearest.x, way, rounding),
        rank(start.y, away.y, beyond.y, up.y, nearest.y, way, rounding),
        rank(start.z, away.z, beyond.z, up.z, nearest.z, way, rounding),
    );
    let axis = farthest(ranks);
    let (start, away) = (axis.dot(start), axis.dot(away));
    let lies = L::and((zero - rounding).lt(start), start.lt(rounding));
    (axis, L::and(lies, away.lt(pressed)))
}

/// The rank of a face among those of a box (`entered`).
#[inline(always)]
fn rank<L: Lanes>(start: L, away: L, beyond: L, up: L, nearest: L, way: L, rounding: L) -> L {
    let zero = L::splat(0.0);
    let was_outside = (zero - rounding).lt(start);
    let slid = L::and(was_outside, L::and(start.lt(rounding), away.lt(way * L::splat(-PRESSED))));
    let leaves = L::and(zero.lt(nearest), zero.lt(away));
    let rank = up.mul_add(L::splat(CARRIES), L::splat(WAS_OUTSIDE));
    let rank = L::select(L::or(slid, leaves), rank + L::splat(SLID), rank);
    L::select(L::or(was_outside, leaves), rank.mul_add(way + rounding, beyond), beyond)
}

/// A box at rest: the half extents (m) of its core, and the radius of its edges.
struct RoundedBox {
    core: Vec3A,
    radius: f32,
}

impl Solid for RoundedBox {
    #[inline(always)]
    fn gap<L: Lanes>(&self, y: Vector<L>) -> Gap<L> {
        let &RoundedBox { core, radius } = self;
        let (side, beyond) = (toward(y), y.abs() - splat(core));
        let outside = positive(beyond);
        let d = outside.times(beyond);
        let length = d.length();
        let axis = farthest(beyond);
        let is_edge = is_edge(outside, length);
        Gap {
            n: Vector::select(is_edge, side.times(d).over(length), side.times(axis)),
            distance: L::select(is_edge, length, axis.dot(beyond)) - L::splat(radius),
            touching: L::splat(TOUCHING * (core.min_element() + radius)),
        }
    }
}

/// Whether points that are outside of some faces, and `length` (m) away from all that is inside of these, are nearest to an
/// edge or a corner.
#[inline(always)]
fn is_edge<L: Lanes>(outside: Vector<L>, length: L) -> L::Mask {
    L::and(L::splat(1.0).lt(outside.x + outside.y + outside.z), L::splat(MIN_LENGTH).lt(length))
}

/// The axis with the largest component; the first of equal ones.
#[inline(always)]
fn farthest<L: Lanes>(v: Vector<L>) -> Vector<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let most = v.x.max(v.y).max(v.z);
    let x = L::select(v.x.lt(most), zero, one);
    let y = L::select(v.y.lt(most), zero, one - x);
    Vector::new(x, y, one - x - y)
}

/// For each axis 1 or -1, the sign of the side that `y` is on.
#[inline(always)]
fn toward<L: Lanes>(y: Vector<L>) -> Vector<L> {
    let (zero, one, other) = (L::splat(0.0), L::splat(1.0), L::splat(-1.0));
    Vector::new(L::select(y.x.lt(zero), other, one), L::select(y.y.lt(zero), other, one), L::select(y.z.lt(zero), other, one))
}

/// 1 for each positive component, 0 for the others.
#[inline(always)]
fn positive<L: Lanes>(v: Vector<L>) -> Vector<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    Vector::new(L::select(zero.lt(v.x), one, zero), L::select(zero.lt(v.y), one, zero), L::select(zero.lt(v.z), one, zero))
}

/// The rotation vector, along the axis with length `tan(angle/2)`, from a quaternion to one that differs by `change`.
/// Neither needs unit length.
fn turn(rotation: Vec4, change: Vec4) -> Vec3A {
    let (from, by) = (Vec3A::from_vec4(rotation), Vec3A::from_vec4(change));
    let axis = by * rotation.w - from * change.w - by.cross(from);
    axis / (rotation.dot(rotation) + rotation.dot(change))
}

/// Rotates a vector by a unit quaternion.
#[inline(always)]
fn turned<L: Lanes>(rotation: Vec4, v: Vector<L>) -> Vector<L> {
    let axis = Vector::splat(rotation.xyz().to_array());
    let across = axis.cross(v) * L::splat(2.0);
    across.mul_add(L::splat(rotation.w), v) + axis.cross(across)
}

/// Rotates a vector by the inverse of a unit quaternion.
#[inline(always)]
fn turned_back<L: Lanes>(rotation: Vec4, v: Vector<L>) -> Vector<L> {
    turned((-rotation.xyz()).extend(rotation.w), v)
}
