//! Collision of vertices with an analytic collider.

use bytemuck::{Pod, Zeroable};
use glam::Vec3A;

use near::NearBodies;
use rounded_box::contact_box;

use super::distance::MIN_LENGTH;
use super::params::{Params, Substep};
use crate::simd::{Lanes, Vector};

pub(crate) mod near;
pub(crate) mod rounded_box;

/// A collider during one step, in local coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Body {
    /// Plane: a point of it. Round body: one end of the axis (a sphere's center). Box: its center. All at the step's
    /// start.
    pub a: [f32; 3],
    /// Round body: the radius at `a`. Box: the radius of its rounded edges, by which it extends beyond its core.
    pub radius: f32,
    /// Plane: its unit normal at the step's start. Round body: the other end of the axis. Box: the half extents of its core, along its own
    /// axes.
    pub b: [f32; 3],
    pub friction: f32,
    /// Change of `a` over the step.
    pub a_travel: [f32; 3],
    /// Change of `radius` over the step.
    pub radius_travel: f32,
    /// Change of `b` over the step.
    pub b_travel: [f32; 3],
    /// [`PLANE`], [`ROUND`] or [`BOX`].
    pub kind: u32,
    /// Round body: by how much the radius at `b` is larger than at `a`, then three unused numbers. Box: its rotation, a
    /// quaternion that has unit length at the step's start and end.
    pub c: [f32; 4],
    /// Change of `c` over the step.
    pub c_travel: [f32; 4],
    /// Box: width (m) of the strip along a sharp edge in which friction fades toward the edge (`rounded_box::grip`).
    pub slick: f32,
    /// By how much (m) the surface is enlarged at most.
    pub margin: f32,
    pub padding: [f32; 2],
}

/// Values of [`Body::kind`].
pub(crate) const PLANE: u32 = 0;
pub(crate) const ROUND: u32 = 1;
pub(crate) const BOX: u32 = 2;

/// Speed (m/s) at which a vertex that began a substep inside a body is pushed out.
pub(crate) const DEPENETRATION: f32 = 1.0;
/// The same within the margin by which a surface is enlarged, where cloth starts that was laid on the surface without it. The cloth around
/// it is stretched until it has slid there, at up to `pi` times this speed over a limb, and friction must stop it: a strip that it holds
/// (`a_strip_hung_over_a_limb_is_held_by_friction`) slid by the 20 mm that it needs up to .1 m/s, by 40 at .2, and off at .4.
pub(crate) const EMERGENCE: f32 = 0.05;
/// A vertex that begins a substep deeper (m) inside a body than this, which exceeds rounding errors, may be squeezed between it and
/// another.
pub(crate) const INSIDE: f32 = 1e-5;
/// A vertex that moves in a substep by more than this share of a body's radius, or of half a box's thickness, is tested
/// along its path (continuous collision detection).
pub(crate) const SWEPT: f32 = 0.25;
/// Maximum number of steps along a path.
pub(crate) const SWEEP_STEPS: u32 = 24;
/// A path touches a body at less than this share of its radius, or of half a box's thickness.
pub(crate) const TOUCHING: f32 = 0.001;

/// Vertices among the bodies that they may touch in a substep.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Path<L> {
    /// Their positions (m), moved out of the bodies so far, and their displacements (m).
    pub x: Vector<L>,
    pub u: Vector<L>,
    /// Their positions before.
    start: Vector<L>,
    /// The displacement (m) there of the body with the most friction of those so far that they began inside of, and its friction; of two
    /// with the same, the mean.
    holder_step: Vector<L>,
    grasp: L,
}

impl<L: Lanes> Path<L> {
    pub(crate) fn new(x: Vector<L>, u: Vector<L>) -> Path<L> {
        Path { x, u, start: x, holder_step: Vector::zero(), grasp: L::splat(0.0) }
    }
}

/// Resolves the collisions of vertices with one body after the other, where they are free to move. Returns `(x, u)` afterwards, or
/// none if the vertices surely touch no body.
#[inline(always)]
pub(crate) fn contact_bodies<L: Lanes>(
    x: Vector<L>,
    u: Vector<L>,
    is_free: L::Mask,
    near: &NearBodies<'_>,
    substep: &Substep,
    params: &Params,
) -> Option<(Vector<L>, Vector<L>)> {
    let (mut path, mut is_clear) = (Path::new(x, u), true);
    let mut visit = near.visit(substep, params);
    while let Some((body, clear)) = visit.next() {
        if L::all(clear.of_vertices(path.x, path.u)) {
            continue;
        }
        let out = contact_body(path, body, substep, params);
        (path.x, path.u) = (Vector::select(is_free, out.x, path.x), Vector::select(is_free, out.u, path.u));
        (path.holder_step, path.grasp) = (out.holder_step, out.grasp);
        is_clear = false;
        if !near.holds(path.x, path.u) {
            visit.visit_all();
        }
    }
    (!is_clear).then_some((path.x, path.u))
}

/// Resolves the collision of vertices with one body. Returns their path afterwards.
///
/// The gap is computed from displacements, so that its rounding error is relative to `u`, not to `x`. Computed from
/// positions it would lose part of `h² g` at hundreds of substeps, and with it part of the friction (0.4 % of the
/// acceleration at 16.9 degrees, friction 0.3, 320 substeps, one meter from the origin; more farther out). The depth at
/// which the vertex already was inside is removed from `x` at a bounded speed, which adds no velocity. The remaining
/// depth is removed from `u`, and Coulomb friction, relative to the body's motion, is proportional to it. The path of a
/// fast vertex is tested for the first touch.
///
/// What two bodies squeeze is pushed by each into the other, so that all depth is old and no force is known, while that of rigid
/// bodies has no limit. So it sticks to the one with more friction, or to the mean motion of two with the same, unless one pushes it along
/// the other by more than friction allows: between surfaces that meet at more than the angle of friction it slips out.
// Code for the web is small instead.
#[cfg_attr(not(target_arch = "wasm32"), inline(always))]
pub(crate) fn contact_body<L: Lanes>(path: Path<L>, body: &Body, substep: &Substep, params: &Params) -> Path<L> {
    let Path { x, u, .. } = path;
    let contact = match body.kind {
        PLANE => contact_plane(x, u, body, substep, params),
        BOX => contact_box(x, u, body, substep, params),
        _ => contact_round(x, u, body, substep, params),
    };
    respond(path, contact, body, params.h)
}

/// A vertex and a body in a substep.
#[derive(Debug, Clone, Copy)]
struct ContactPoint<L> {
    /// The body's unit normal where the vertex touches it, or is nearest to it at the substep's end.
    n: Vector<L>,
    /// The signed gap (m) at the substep's start, and at its end if nothing is done.
    before: L,
    after: L,
    /// The body's displacement (m) there.
    step: Vector<L>,
    /// Share of the friction.
    grip: L,
}

/// Pushes vertices out along the normal, and applies friction. Returns their path afterwards.
#[inline(always)]
fn respond<L: Lanes>(path: Path<L>, contact: ContactPoint<L>, body: &Body, h: f32) -> Path<L> {
    let (Path { x, u, start, .. }, ContactPoint { n, before, after, step, grip }) = (path, contact);
    let zero = L::splat(0.0);
    let depth = zero - after;
    let old = depth.min((zero - before).max(zero));
    let push = depth - old;
    let pushed = n.mul_add(push, u);
    let relative = pushed - step;
    let slip = relative - n * n.dot(relative);
    let friction = L::splat(body.friction) * grip;
    let share = friction * push / slip.length().max(L::splat(1e-30));
    let held = pushed - slip * share.min(L::splat(1.0));
    let below = (old - L::splat(body.margin)).min(L::splat(DEPENETRATION * h));
    let freed = old.min(below.max(L::splat(EMERGENCE * h)));
    let out = n.mul_add(freed, x);
    let inside = after.lt(zero);
    let mut after = Path { x: Vector::select(inside, out, x), u: Vector::select(inside, held, u), ..path };
    let began_inside = L::and(inside, L::splat(INSIDE).lt(old));
    if L::any(began_inside) {
        let holds = L::and(began_inside, path.grasp.lt(friction));
        let shares = L::and(began_inside, L::eq(path.grasp, friction));
        let shared = Vector::select(shares, (path.holder_step + step) * L::splat(0.5), path.holder_step);
        after.holder_step = Vector::select(holds, step, shared);
        after.grasp = L::select(holds, friction, path.grasp);
        let moved = x - start;
        let along = |v: Vector<L>| v - n * n.dot(v);
        let slid = along(moved);
        // Once two squeeze it, the other moves it by no less than the slowest push, but for rounding.
        let least = L::splat(INSIDE.min(0.5 * EMERGENCE * h));
        let squeezed = L::and(began_inside, least.lt(zero - n.dot(moved)));
        let sticks = L::and(squeezed, slid.length().lt(after.grasp * freed));
        after.x = Vector::select(sticks, out - slid, after.x);
        after.u = Vector::select(sticks, pushed + along(after.holder_step - pushed), after.u);
    }
    after
}

/// [`Body::a`] at the start of a substep, and its displacement.
#[inline(always)]
fn axis_end(body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
    let travel = Vec3A::from(body.a_travel);
    (Vec3A::from(body.a) + travel * substep.start, travel * params.fraction)
}

/// Of a half-space. While its normal turns, from `n_0` to `n_1` in a substep, the solid also moves by `(n_0 x n_1) x r` at `r` from its
/// point. This `r` is taken in the middle of that motion: with that at its start, what the solid carries would creep outward.
#[inline(always)]
fn contact_plane<L: Lanes>(x: Vector<L>, u: Vector<L>, body: &Body, substep: &Substep, params: &Params) -> ContactPoint<L> {
    let (a, a_step) = axis_end(body, substep, params);
    let (b, b_travel) = (Vec3A::from(body.b), Vec3A::from(body.b_travel));
    let (r, mut n, mut step) = (x - splat(a), splat(b), splat(a_step));
    let mut before = n.dot(r);
    if b_travel != Vec3A::ZERO {
        let [n_0, n_1] = [substep.start, substep.start + params.fraction].map(|time| splat((b + b_travel * time).normalize()));
        before = n_0.dot(r);
        let axis = n_0.cross(n_1);
        step = step + axis.cross(axis.cross(r) * L::splat(0.5) + r);
        n = n_1;
    }
    ContactPoint { n, before, after: before + n.dot(u - step), step, grip: L::splat(1.0) }
}

/// Of a sphere or a capsule.
#[inline(always)]
fn contact_round<L: Lanes>(x: Vector<L>, u: Vector<L>, body: &Body, substep: &Substep, params: &Params) -> ContactPoint<L> {
    let (a, a_step) = axis_end(body, substep, params);
    let b = Vec3A::from(body.b) + Vec3A::from(body.b_travel) * substep.start;
    let b_step = Vec3A::from(body.b_travel) * params.fraction;
    let (taper, taper_step) = (body.c[0] + body.c_travel[0] * substep.start, body.c_travel[0] * params.fraction);
    let radius_a = body.radius + body.radius_travel * substep.start;
    let t = nearest(a + a_step, b + b_step, taper + taper_step, x + u);
    let radius = L::splat(taper).mul_add(t, L::splat(radius_a));
    let growth = L::splat(taper_step).mul_add(t, L::splat(body.radius_travel * params.fraction));
    let step = splat::<L>(b_step - a_step).mul_add(t, splat(a_step));
    let d0 = x - splat::<L>(b - a).mul_add(t, splat(a));
    let du = u - step;
    let d = d0 + du;
    let (start, end) = (d0.length(), d.length());
    let before = start - radius;
    let travel2 = du.dot(du);
    let moved = d0.dot(du).mul_add(L::splat(2.0), travel2);
    let mut after = before + moved / (start + end).max(L::splat(1e-20));
    let mut n = Vector::select(L::splat(MIN_LENGTH).lt(end), d.over(end), Vector::splat([0.0, 1.0, 0.0]));
    let swept_from = radius * L::splat(SWEPT);
    // A vertex at rest on the surface may be inside by a rounding error.
    let is_fast = L::and((L::splat(0.0) - swept_from).lt(before), (swept_from * swept_from).lt(travel2));
    if L::any(is_fast) {
        let touch = swept(x, du, travel2.sqrt(), is_fast, Round { a, b, taper, radius: radius_a });
        n = Vector::select(touch.hit, touch.n, n);
        after = L::select(touch.hit, touch.after, after);
    }
    ContactPoint { n, before, after: after - growth, step, grip: L::splat(1.0) }
}

/// Parameter, from 0 at `a` to 1 at `b`, of that ball of a round body whose surface is nearest to `x`. The body is the
/// union of balls along the axis, with a radius larger by `taper` at `b`. On a cone the normal is inclined to the
/// perpendicular of the axis by an angle of sine `taper / |b - a|`.
#[inline(always)]
fn nearest<L: Lanes>(a: Vec3A, b: Vec3A, taper: f32, x: Vector<L>) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let axis = b - a;
    let square = axis.length_squared();
    let from = x - splat(a);
    let along = from.dot(splat(axis)) * L::splat(1.0 / square.max(1e-20));
    if taper == 0.0 {
        return along.max(zero).min(one);
    }
    let cone = square - taper * taper;
    if cone <= 0.0 {
        // The larger ball contains the smaller one.
        return if taper > 0.0 { one } else { zero };
    }
    let across = (from - splat::<L>(axis) * along).length();
    across.mul_add(L::splat(taper / (cone * square).sqrt()), along).max(zero).min(one)
}

/// A shape at rest.
trait Solid {
    fn gap<L: Lanes>(&self, x: Vector<L>) -> Gap<L>;
}

/// The hull of two balls around the ends `a` and `b` of an axis, with `radius` at `a` and `taper` more at `b`.
struct Round {
    a: Vec3A,
    b: Vec3A,
    taper: f32,
    radius: f32,
}

impl Solid for Round {
    #[inline(always)]
    fn gap<L: Lanes>(&self, x: Vector<L>) -> Gap<L> {
        let &Round { a, b, taper, radius } = self;
        let t = nearest(a, b, taper, x);
        let d = x - splat::<L>(b - a).mul_add(t, splat(a));
        let (distance, radius) = (d.length(), L::splat(taper).mul_add(t, L::splat(radius)));
        Gap { n: d.over(distance.max(L::splat(1e-20))), distance: distance - radius, touching: radius * L::splat(TOUCHING) }
    }
}

/// The normal of a surface at its point nearest to a given point, the signed distance (m), and below which distance that
/// counts as touching.
#[derive(Debug, Clone, Copy)]
struct Gap<L> {
    n: Vector<L>,
    distance: L,
    touching: L,
}

/// The first touch of a path with a surface, if it is `hit`: the normal there, and the gap (m) between the path's end and
/// the tangent plane.
struct Touch<L: Lanes> {
    hit: L::Mask,
    n: Vector<L>,
    after: L,
}

/// The first touch of the paths `x + s du`, of length `travel` and looked at only if `is_fast`, with a surface at rest. Steps
/// along the path by the distance to the surface (sphere tracing: Hart 1996), which never passes through it.
#[inline(always)]
fn swept<L: Lanes>(x: Vector<L>, du: Vector<L>, travel: L, is_fast: L::Mask, surface: impl Solid) -> Touch<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let mut touch = Touch { hit: zero.lt(zero), n: Vector::zero(), after: zero };
    let (mut s, mut is_on_its_way) = (zero, is_fast);
    for _ in 0..SWEEP_STEPS {
        let Gap { n, distance, touching } = surface.gap(du.mul_add(s, x));
        let touches = L::and(is_on_its_way, distance.lt(touching));
        touch.hit = L::or(touch.hit, touches);
        touch.n = Vector::select(touches, n, touch.n);
        touch.after = L::select(touches, n.dot(du).mul_add(one - s, distance), touch.after);
        // A path that touches is over.
        s = L::select(touches, one, s + distance / travel);
        is_on_its_way = L::and(is_on_its_way, s.lt(one));
        if !L::any(is_on_its_way) {
            break;
        }
    }
    touch
}

/// The same vector in every lane.
#[inline(always)]
fn splat<L: Lanes>(v: Vec3A) -> Vector<L> {
    Vector::splat(v.to_array())
}

#[cfg(test)]
#[path = "../../tests/unit/kernels_contact.rs"]
mod tests;
