//! The mathematics, as pure functions: values in, values out. `shaders/` holds the same functions; where a stage has the plain name,
//! its function says of what (`project`, `project_edge`).
//!
//! Within a substep of length `h` a vertex is at `x` (m) and will move by `u` (m); `p` (m) is its displacement over the
//! substep before, so its velocity is `p / h`. Everything is written in displacements: formed as `(x - x_prev) / h` in
//! single precision, a velocity loses gravity altogether once `h^2 g` nears the last bit of `x`. Storing `p` rather than
//! `v` spares a division and lets no rounding of `v -> h v -> v` add up over thousands of substeps.

#![cfg_attr(not(test), allow(dead_code, reason = "what the wide loops and shaders do is said here; tests compare with it"))]

use bytemuck::{Pod, Zeroable};
use glam::{Vec3A, Vec4};

/// What is the same for every vertex and every substep of a step.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Params {
    /// Gravity plus the linear drag toward the wind, `g + c v_air` (m/s²).
    pub acceleration: [f32; 3],
    /// Substep (s).
    pub h: f32,
    /// Velocity of the air (m/s).
    pub wind: [f32; 3],
    /// Half the density of the air (kg/m³).
    pub half_density: f32,
    pub drag: f32,
    pub lift: f32,
    /// One over the number of substeps.
    pub fraction: f32,
    pub vertices: u32,
    pub bodies: u32,
    pub pins: u32,
    /// 1 if bending is damped.
    pub damped: u32,
    /// 1 if there is more to predict by than the last displacement and a uniform acceleration: forces, or pins that are led.
    pub predicted: u32,
    pub substeps: u32,
    /// Sweeps over the edges in a substep.
    pub sweeps: u32,
    /// 1 if edges are relaxed (Jakobsen), not projected.
    pub relaxed: u32,
    /// Coarse levels in use.
    pub levels: u32,
}

/// What differs from one substep to the next.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
pub(crate) struct Substep {
    /// Share of the last displacement that carries over: drag, and the ratio of this substep to the last.
    pub carry: f32,
    /// Displacement by a unit of acceleration (s²): `h²`, half of it in the first substep (leapfrog start).
    pub gain: f32,
    /// One over the last substep (1/s): turns `p` into a velocity.
    pub rate: f32,
    /// Where the substep begins and ends within the step, 0..1.
    pub start: f32,
    pub end: f32,
}

/// An edge, ready for one length of substep.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Edge {
    pub a: u32,
    pub b: u32,
    /// One over the rest length (1/m).
    pub inverse_rest: f32,
    /// `1 / (w_a + w_b + a')` (kg), `a'` the shifted compliance over `h²`.
    pub inverse_weight: f32,
}

/// A spring seen from one of its ends.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Spring {
    pub other: u32,
    /// Rest length (m).
    pub rest: f32,
    /// Stiffness (N/m).
    pub stiffness: f32,
}

/// A vertex's row of the bending energy: `stiffness/2 |sum_j c_vj (x_j - x_v)|²`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendRow {
    /// `B_v D_v`; B limited where explicit integration needs it.
    pub stiffness: f32,
    /// Retardation time (s).
    pub tau: f32,
    /// `c_vv = -sum_j c_vj`.
    pub diagonal: f32,
}

/// A neighbour in a vertex's row of the bending energy.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct BendEntry {
    pub other: u32,
    /// `c_vj`: the neighbour in this vertex's row.
    pub forward: f32,
    /// `c_jv`: this vertex in the neighbour's row.
    pub backward: f32,
}

/// A triangle that the air acts on.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Panel {
    pub corners: [u32; 3],
    /// Mass (kg) that its force moves: its area times the least areal density of its corners.
    pub mass: f32,
}

/// A collider during one step, in local coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Body {
    /// Plane: a point of it. Round: one end of the axis (a sphere's centre), at the step's start.
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

/// A pinned vertex on its way through a step, in local coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Pin {
    pub origin: [f32; 3],
    pub vertex: u32,
    pub goal: [f32; 3],
    pub padding: u32,
}

pub(crate) const PLANE: u32 = 0;
pub(crate) const ROUND: u32 = 1;

/// SHAKE's direction is used while the edge has turned by less than this (cosine) ...
pub(crate) const TURN_GUARD: f32 = 0.9;
/// ... and its squared length is within this share of its rest value, at the substep's start and end.
pub(crate) const STRETCH_GUARD: f32 = 0.1;
/// No edge is shorter (m) where its length divides.
pub(crate) const LEAST_LENGTH: f32 = 1e-12;
/// Speed (m/s) at which a vertex that began a substep inside a body is moved out of it.
pub(crate) const DEPENETRATION: f32 = 1.0;
/// A vertex that moves by more than this share of a body's radius in a substep is swept along its path.
pub(crate) const SWEPT: f32 = 0.25;
pub(crate) const SWEEP_STEPS: u32 = 24;

/// Displacement predicted from the last one and an acceleration: leapfrog, exact for linear drag.
pub(crate) fn predict(p: Vec3A, acceleration: Vec3A, substep: &Substep) -> Vec3A {
    p * substep.carry + acceleration * substep.gain
}

/// Impulse of an edge in displacement form: add `w_a` times it to `u_a`, subtract `w_b` times it from `u_b`.
///
/// `C = l - l0`, corrected along the edge's direction at the substep's start (SHAKE: Ryckaert et al. 1977) while the edge
/// has hardly turned or stretched, else along its current direction (XPBD: Macklin et al. 2016). `l - l0` is a series in
/// `r = (l/l0)² - 1`, and so is one over the length at the start, so the common case has no square root; the rest length
/// cancels. Without the second series the edge would be stiffer by its own strain, at every substep; its guard keeps it
/// from the edges of a scrambled cloth, where it diverges.
pub(crate) fn project(d0: Vec3A, du: Vec3A, edge: &Edge) -> Vec3A {
    let d = d0 + du;
    let inverse_square = edge.inverse_rest * edge.inverse_rest;
    let r = d.dot(d) * inverse_square - 1.0;
    let c = d0.dot(d) * inverse_square;
    let r0 = d0.dot(d0) * inverse_square - 1.0;
    if c > TURN_GUARD && r.abs() < STRETCH_GUARD && r0.abs() < STRETCH_GUARD {
        let unit = 1.0 - r0 * (0.5 - r0 * 0.375);
        d0 * (-edge.inverse_weight * unit * r * (0.5 - r * (0.125 - r * 0.0625)))
    } else {
        relax(d0, du, edge)
    }
}

/// Impulse of a coarse edge, which is that of an edge but only pulls: centres of cloth may come as near as they like.
pub(crate) fn project_coarse(d0: Vec3A, du: Vec3A, edge: &Edge) -> Vec3A {
    let d = d0 + du;
    if d.dot(d) * edge.inverse_rest * edge.inverse_rest <= 1.0 { Vec3A::ZERO } else { project(d0, du, edge) }
}

/// Impulse of an edge along its current direction: Jakobsen's relaxation (2001) where the edge has no compliance.
pub(crate) fn relax(d0: Vec3A, du: Vec3A, edge: &Edge) -> Vec3A {
    let d = d0 + du;
    let length = d.length().max(LEAST_LENGTH);
    d * (edge.inverse_weight * (1.0 / (edge.inverse_rest * length) - 1.0))
}

/// Force (N) of a spring on the end that `d` points away from.
pub(crate) fn spring_force(d: Vec3A, spring: &Spring) -> Vec3A {
    let length = d.length().max(LEAST_LENGTH);
    d * (spring.stiffness * (length - spring.rest) / length)
}

/// What a vertex's ring does around it, gathered neighbour by neighbour: `d` points to it, `rate` is how fast `d` changes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Ring {
    /// Mean curvature normal `y = sum_j c_vj d_j`, and its rate.
    pub y: Vec3A,
    pub y_rate: Vec3A,
    /// Sum of `d x rate`, and of `|d|² 1 - d d^T`: its diagonal, and its xy, xz, yz.
    pub spin: Vec3A,
    pub inertia: Vec3A,
    pub products: Vec3A,
}

impl Ring {
    /// Adds the neighbour at `d` with coefficient `c_vj`.
    pub(crate) fn add(&mut self, d: Vec3A, rate: Vec3A, coefficient: f32) {
        self.y += d * coefficient;
        self.y_rate += rate * coefficient;
        self.spin += d.cross(rate);
        self.inertia += Vec3A::new(d.y * d.y + d.z * d.z, d.x * d.x + d.z * d.z, d.x * d.x + d.y * d.y);
        self.products -= Vec3A::new(d.x * d.y, d.x * d.z, d.y * d.z);
    }
}

/// Moment and couple of a vertex's bending row.
///
/// The moment is `stiffness (y + tau dy/dt)`; neighbour `j` feels `-c_vj` times it. Taken as it is, the rate `dy/dt` would
/// also brake the rotation of cloth that is bent but rigid, by the torque `-tau B D y x dy/dt`. So the rate is measured
/// against the ring's own rotation, `omega = I^-1 sum d x dd/dt`, and what that adds to the dissipation's gradient is the
/// couple: neighbour `j` also feels `couple x d_j`. Together they exert no torque, and never give energy.
/// A ring in one line (a free edge) has no rotation about itself; there the part of the rate along `y` alone is damped.
pub(crate) fn bend_moment(ring: &Ring, row: &BendRow) -> (Vec3A, Vec3A) {
    if row.tau == 0.0 {
        return (ring.y * row.stiffness, Vec3A::ZERO);
    }
    let damping = row.stiffness * row.tau;
    let (omega, planar) = unspin(ring.inertia, ring.products, ring.spin);
    if !planar {
        // Below 1e-15 a curvature has no direction left, and the damping fades out.
        let growth = ring.y.dot(ring.y_rate) / ring.y.dot(ring.y).max(1e-30);
        return (ring.y * (row.stiffness + damping * growth), Vec3A::ZERO);
    }
    let resisted = (ring.y_rate - omega.cross(ring.y)) * damping;
    let (couple, _) = unspin(ring.inertia, ring.products, ring.y.cross(resisted));
    (ring.y * row.stiffness + resisted, couple)
}

/// The couples that act between a vertex and a neighbour: of the rows whose ring has the other in it.
pub(crate) fn couple(own: Vec3A, other: Vec3A, entry: &BendEntry) -> Vec3A {
    let in_ring = |coefficient: f32| if coefficient == 0.0 { 0.0 } else { 1.0 };
    own * in_ring(entry.forward) + other * in_ring(entry.backward)
}

/// Solves `I omega = spin` for a symmetric inertia; false, and nothing, if the ring is (nearly) in one line.
fn unspin(inertia: Vec3A, products: Vec3A, spin: Vec3A) -> (Vec3A, bool) {
    let scale = 1.0 / (inertia.x + inertia.y + inertia.z).max(1e-30);
    let (i, q) = (inertia * scale, products * scale);
    let diagonal = Vec3A::new(i.y * i.z - q.z * q.z, i.x * i.z - q.y * q.y, i.x * i.y - q.x * q.x);
    let corners = Vec3A::new(q.y * q.z - q.x * i.z, q.x * q.z - q.y * i.y, q.x * q.y - q.z * i.x);
    let determinant = i.x * diagonal.x + q.x * corners.x + q.y * corners.y;
    if determinant < 1e-4 {
        return (Vec3A::ZERO, false);
    }
    let omega = Vec3A::new(
        diagonal.x * spin.x + corners.x * spin.y + corners.y * spin.z,
        corners.x * spin.x + diagonal.y * spin.y + corners.z * spin.z,
        corners.y * spin.x + corners.z * spin.y + diagonal.z * spin.z,
    );
    (omega * (scale / determinant), true)
}

/// Force (N) of the air on a triangle (Keckeisen et al. 2004). With `v` its velocity relative to the air, `v_n` and `v_t` the
/// parts along and across its normal, and `s = |v_n|/|v|`: drag `-rho/2 A C_D |v_n| v` along the stream, and lift
/// `-rho/2 A C_L |v| (v_n - s² v)` across it, largest at 45 degrees.
///
/// Resolved into `-A (k_n v_n + k_t v_t)`, each `k` limited to `k / (1 + kick k A/m)`, `kick` (s) being the time the force acts:
/// exact for a free panel in steady air, and never reverses the velocity relative to it, however strong the wind.
pub(crate) fn wind_force(x: [Vec3A; 3], velocity: Vec3A, mass: f32, substep: &Substep, params: &Params) -> Vec3A {
    let cross = (x[1] - x[0]).cross(x[2] - x[0]);
    let double_area = cross.length();
    if double_area < 1e-20 {
        return Vec3A::ZERO;
    }
    let n = cross / double_area;
    let area = 0.5 * double_area;
    let relative = velocity - Vec3A::from(params.wind);
    let along = n.dot(relative);
    let normal = n * along;
    let tangential = relative - normal;
    let speed = relative.length().max(1e-10);
    let sine = along.abs() / speed;
    let kick = substep.gain / params.h;
    let limited = |k: f32| k * area / (1.0 + kick * k * area / mass);
    let k_n = limited(params.half_density * (params.drag * along.abs() + params.lift * speed * (1.0 - sine * sine)));
    let k_t = limited(params.half_density * along.abs() * (params.drag - params.lift * sine));
    -(normal * k_n + tangential * k_t)
}

/// Contact of a vertex at `x` about to move by `u` with one body: `(x, u)` afterwards.
///
/// The gap is formed in displacements, so that it is right to the last bit of `u`, not of `x`: formed in positions it loses
/// part of `h² g` to rounding at hundreds of substeps, and with it part of friction (0.4 % of the acceleration at 16.9
/// degrees and friction 0.3, 320 substeps, a metre from the origin; more farther out). What the vertex was already
/// inside by is taken out of `x` at a bounded speed and gives it no velocity; the rest is taken out of `u`, and is what
/// friction (Coulomb, relative to the body's own motion) is measured by. A fast vertex is swept along its path.
pub(crate) fn contact(x: Vec3A, u: Vec3A, body: &Body, substep: &Substep, params: &Params) -> (Vec3A, Vec3A) {
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
    let n = if end > 1e-12 { d / end } else { Vec3A::Y };
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

/// The xyz of a vertex stored with a fourth number.
pub(crate) fn xyz(v: Vec4) -> Vec3A {
    Vec3A::from_vec4(v)
}
