//! The loads on a cloth during a step, as far as they stretch it.

use std::mem::discriminant;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec3};

use crate::attributes::{Attributes, Collider, Shape};
use crate::kernels::statistics::Statistics;
use crate::model::cloth::Cloth;
use crate::model::mesh::{around, bounds, near_vertices};
use crate::options::Cause;
use crate::record::recorded;
use crate::step::motion::{Motion, Whereabouts};

/// The accelerations, speeds and pressures that determine the membrane stress.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Load {
    /// Gravity and linear drag (m/s²): see [`ambient_acceleration`].
    pub ambient: f64,
    /// Acceleration (m/s²) of the pin whose velocity changes the most in this step.
    pub pins: f64,
    /// The 95th percentile of the free vertices' speed (m/s) relative to the pins, or to the course of cloth without any.
    pub cloth_speed: f64,
    /// Speed of the fastest collider that may touch the cloth (m/s), relative to the pins where that is slower, and to the
    /// course of cloth without any.
    pub collider_speed: f64,
    /// With contact of triangles: how fast (m/s) pins and mesh colliders move relative to each other; contact has to
    /// give way to that.
    pub kinematic_speed: f64,
    /// Dynamic pressure (Pa) of the wind on cloth that goes along with the pins, facing it.
    pub pressure: f64,
    /// The same in this step or the last one, whichever is less: pins that are jerked make no gale.
    pub lasting_pressure: f64,
}

recorded!(Load { ambient, pins, cloth_speed, collider_speed, kinematic_speed, pressure, lasting_pressure });

/// What moves fastest in a step: an index in its list, and its speed (m/s).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Fastest {
    /// Of the pins, relative to their mean velocity in the last step if the cloth goes along with that.
    pub pin: (usize, f64),
    /// Of the colliders that may touch the cloth, and of those among them that are no mesh; relative to the pins where that is
    /// slower, and to the course of cloth without any.
    pub collider: (usize, f64),
    pub solid: (usize, f64),
    /// The speeds (m/s) of the fastest pin, and of the fastest collider anywhere.
    pub any_pin: f64,
    pub any_collider: f64,
    /// The displacement (m) of the pins, or of cloth without any: see [`Motion::drift`].
    pub drift: Vec3,
    /// Where the cloth may be in the step, as far as that is known.
    pub whereabouts: Option<Whereabouts>,
}

/// What the load in a step of `dt` (s) follows from.
#[derive(Clone, Copy)]
pub(crate) struct LoadInputs<'a> {
    pub cloth: &'a Cloth,
    /// Where the last step left off.
    pub motion: &'a Motion,
    pub attributes: &'a Attributes,
    pub dt: f32,
    /// The latest statistics.
    pub seen: Option<&'a Statistics>,
}

impl Fastest {
    /// In a step; `age` (s) is the time since the latest statistics.
    pub(crate) fn of(inputs: LoadInputs<'_>, age: f32) -> Fastest {
        let LoadInputs { cloth, motion, attributes, dt, seen } = inputs;
        let (drift, last_drift) = (motion.drift(cloth, attributes.pin_targets.as_deref(), dt), motion.last_drift(cloth));
        let whereabouts = motion.whereabouts(seen).map(|of_cloth| of_cloth.along(last_drift * age + drift));
        // The statistics count speeds relative to the drift. Cloth of which nothing is known has come along by the next step.
        let speed = seen.map(|seen| seen.speed_of(0.95)).or(motion.placed.map(|of_cloth| of_cloth.fastest));
        let common = last_drift.as_dvec3();
        let goes_along = speed.is_none_or(|speed| f64::from(speed) < 0.5 * common.length());
        let mut fastest = Fastest { drift, whereabouts, ..Fastest::default() };
        fastest.note_pins(inputs, if goes_along { common } else { DVec3::ZERO });
        fastest.note_colliders(inputs);
        fastest
    }

    /// Notes the pins, whose speeds count relative to a velocity (m/s) that they have in `common` with the cloth. The cloth may be as
    /// fast as they are.
    fn note_pins(&mut self, LoadInputs { cloth, motion, attributes, dt, .. }: LoadInputs<'_>, common: DVec3) {
        let targets = attributes.pin_targets.iter().flatten().zip(&motion.pins);
        for (index, (to, from)) in targets.enumerate().filter(|(index, _)| cloth.is_used(cloth.pinned[*index])) {
            let velocity = ((*to - cloth.origin).as_dvec3() - from.as_dvec3()) / f64::from(dt);
            self.any_pin = self.any_pin.max(velocity.length());
            self.pin = faster(self.pin, (index, velocity.distance(common)));
            let relative = (velocity - (self.drift / dt).as_dvec3()).length() as f32;
            self.whereabouts.iter_mut().for_each(|of_cloth| of_cloth.fastest = of_cloth.fastest.max(relative));
        }
    }

    /// Notes the colliders, given where the cloth may be.
    fn note_colliders(&mut self, LoadInputs { cloth, motion, attributes, dt, .. }: LoadInputs<'_>) {
        let dt = f64::from(dt);
        for (index, (now, last)) in motion.followed(&attributes.colliders).enumerate() {
            let within = self.whereabouts.map(|of_cloth| of_cloth.bounds(cloth));
            let way = travel(&now.shape, &last.shape, Vec3::ZERO, within);
            self.any_collider = self.any_collider.max(way / dt);
            // What goes along with the cloth, like the body of a runner in his cape, does not run into it.
            let relative = if self.drift == Vec3::ZERO { way } else { travel(&now.shape, &last.shape, self.drift, within) };
            // Pins hold the cloth back from what is still; without any it runs into that on its course.
            let (speed, reach) = if cloth.has_pins() { (way.min(relative), way) } else { (relative, relative) };
            let speed = speed / dt;
            if speed > self.solid.1 && is_near(cloth, now, reach, dt, self.whereabouts) {
                self.collider = faster(self.collider, (index, speed));
                if now.shape.mesh().is_none() {
                    self.solid = (index, speed);
                }
            }
        }
    }
}

/// The faster of two things, of equally fast ones the first.
fn faster(one: (usize, f64), other: (usize, f64)) -> (usize, f64) {
    if other.1 > one.1 { other } else { one }
}

impl Load {
    /// Membrane stress (N/m): `rho ((|g| + a_pin) L + v²) + q L`, where v is the larger of the two speeds and L the
    /// cloth's extent.
    pub(crate) fn stress(&self, cloth: &Cloth) -> f64 {
        self.stress_without_wind(cloth) + self.pressure * cloth.extents.extent
    }

    /// Membrane stress (N/m) as in [`Load::stress`], but without the wind, which stretches the cloth little as long as
    /// the cloth gives way to it.
    pub(crate) fn stress_without_wind(&self, cloth: &Cloth) -> f64 {
        let speed = self.cloth_speed.max(self.collider_speed);
        cloth.density * ((self.ambient + self.pins) * cloth.extents.extent + speed * speed)
    }

    /// The membrane stress (N/m) by gravity and linear drag alone.
    pub(crate) fn weight(&self, cloth: &Cloth) -> f64 {
        cloth.density * self.ambient * cloth.extents.extent
    }

    /// The time (s) in which cloth that gravity and linear drag alone move falls by half of its size.
    pub(crate) fn falling_time(&self, cloth: &Cloth) -> f64 {
        (cloth.extents.extent / self.ambient).sqrt()
    }

    /// Whether what moves adds less than a third to the stress of gravity.
    pub(crate) fn is_calm(&self, cloth: &Cloth) -> bool {
        self.stress_without_wind(cloth) < 1.3 * self.weight(cloth)
    }

    /// The same for the stress of gravity and wind.
    pub(crate) fn is_calm_in_wind(&self, cloth: &Cloth) -> bool {
        self.stress_without_wind(cloth) - self.weight(cloth) < 0.3 * (self.weight(cloth) + self.pressure * cloth.extents.extent)
    }

    /// The term that contributes most to the stress.
    pub(crate) fn cause(&self, cloth: &Cloth) -> Cause {
        let weighed = |acceleration: f64, speed: f64| cloth.density * (acceleration * cloth.extents.extent + speed * speed);
        let terms = [
            (Cause::Pins, weighed(self.pins, 0.0)),
            (Cause::Collider, weighed(0.0, self.collider_speed)),
            (Cause::Wind, self.pressure * cloth.extents.extent),
            // The last one of equal terms is taken: without any load it is the cloth's own motion.
            (Cause::Motion, weighed(self.ambient, self.cloth_speed)),
        ];
        terms.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(Cause::Motion, |(cause, _)| cause)
    }

    /// The load in a step, in which this moves `fastest`; `thickness` (m) is that of contact of triangles, if the scene has any.
    pub(crate) fn of(inputs: LoadInputs<'_>, fastest: &Fastest, thickness: Option<f64>) -> Load {
        let LoadInputs { cloth, motion, attributes, dt, seen } = inputs;
        let relative = pressure_of(attributes, attributes.wind - fastest.drift / dt);
        let ambient = ambient_acceleration(attributes, fastest.drift / dt);
        // Still air hardly stretches cloth that flies through it: the cloth gives way as a whole.
        let (pressure, ambient) = if cloth.has_pins() {
            (relative, ambient)
        } else {
            (relative.min(still_pressure(inputs, fastest)), ambient.min(ambient_acceleration(attributes, Vec3::ZERO)))
        };
        Load {
            ambient,
            pins: pin_acceleration(inputs),
            cloth_speed: seen.map_or(0.0, |seen| f64::from(seen.speed_of(0.95))),
            collider_speed: fastest.collider.1,
            pressure,
            lasting_pressure: pressure.min(pressure_of(attributes, attributes.wind - motion.last_drift(cloth))),
            kinematic_speed: thickness.map_or(0.0, |thickness| kinematic_speed(inputs, thickness as f32, fastest.whereabouts)),
        }
    }
}

/// Dynamic pressure (Pa) of the wind on cloth at rest in the caller's frame, facing it.
pub(crate) fn pressure(attributes: &Attributes) -> f64 {
    pressure_of(attributes, attributes.wind)
}

/// Dynamic pressure (Pa) of the wind on cloth without pins that has come to rest: in the caller's frame or on a collider that is
/// near, whichever goes along with the wind. The seat of an open car is as still as one on the ground.
fn still_pressure(LoadInputs { cloth, motion, attributes, dt, .. }: LoadInputs<'_>, fastest: &Fastest) -> f64 {
    let still = pressure(attributes);
    if still == 0.0 {
        return still;
    }
    let is_same_kind = |(now, last): &(&Collider, &Collider)| discriminant(&now.shape) == discriminant(&last.shape);
    let near = motion.followed(&attributes.colliders).filter(is_same_kind).filter(|(now, last)| {
        let within = fastest.whereabouts.map(|of_cloth| of_cloth.bounds(cloth));
        let travel = travel(&now.shape, &last.shape, fastest.drift, within);
        is_near(cloth, now, travel, f64::from(dt), fastest.whereabouts)
    });
    let velocities = near.map(|(now, last)| (now.landmarks()[0] - last.landmarks()[0]) / dt);
    velocities.map(|velocity| pressure_of(attributes, attributes.wind - velocity)).fold(still, f64::min)
}

/// Dynamic pressure (Pa) of air that moves at this velocity (m/s) relative to the cloth.
fn pressure_of(attributes: &Attributes, wind: Vec3) -> f64 {
    0.5 * f64::from(attributes.air_density) * f64::from(attributes.drag) * wind.as_dvec3().length_squared()
}

/// The acceleration (m/s²) by gravity and by linear drag toward the wind of cloth that is kept at a `velocity` (m/s); at least that
/// by gravity, because what sinks at its final speed is stopped some time.
pub(crate) fn ambient_acceleration(attributes: &Attributes, velocity: Vec3) -> f64 {
    let gravity = attributes.gravity.as_dvec3();
    let dragged = gravity + f64::from(attributes.damping) * (attributes.wind - velocity).as_dvec3();
    gravity.length().max(dragged.length())
}

/// The acceleration (m/s²) equivalent to all that loads cloth which moves at `velocity` (m/s).
pub(crate) fn loading_acceleration(cloth: &Cloth, attributes: &Attributes, velocity: Vec3) -> f64 {
    ambient_acceleration(attributes, velocity) + pressure_of(attributes, attributes.wind - velocity) / cloth.density
}

/// What changes after a step much longer than this one may have changed at any time in it, but also just now: the time that it took
/// is at most this many times that of the step.
const HITCH: f32 = 4.0;

/// The largest change of a pin's velocity in a step over `dt` (m/s²). Pins that followed targets in the last step and no
/// longer do stop at once.
fn pin_acceleration(LoadInputs { cloth, motion, attributes, dt, .. }: LoadInputs<'_>) -> f64 {
    let targets = attributes.pin_targets.as_deref().unwrap_or_default();
    if targets.is_empty() && motion.dt == 0.0 {
        return 0.0;
    }
    let velocity = |slot: usize| targets.get(slot).map_or(Vec3::ZERO, |&target| (target - cloth.origin - motion.pins[slot]) / dt);
    // Both are mean velocities of their steps, and belong to the middle of each.
    let apart = if motion.dt > 0.0 && !targets.is_empty() { (0.5 * (motion.dt + dt)).min(HITCH * dt) } else { dt };
    let before = |slot: usize| motion.pin_velocities.get(slot).copied().unwrap_or_default();
    let pins = (0..targets.len().max(motion.pin_velocities.len())).filter(|&slot| cloth.is_used(cloth.pinned[slot]));
    let change = pins.map(|slot| velocity(slot).distance(before(slot))).fold(0.0, f32::max);
    f64::from(change) / f64::from(apart)
}

/// Whether a collider may touch the cloth during a step of `dt` (s) in which it moves by `travel` (m) relative to the cloth's
/// course. True if the `whereabouts` of the cloth is not known.
fn is_near(cloth: &Cloth, collider: &Collider, travel: f64, dt: f64, whereabouts: Option<Whereabouts>) -> bool {
    whereabouts.is_none_or(|Whereabouts { low, high, fastest }| {
        let reach = STEPS_AHEAD * (f64::from(fastest) * dt + travel);
        // The vertices of meshes are not shifted by `relative_to`, so the box is compared in the caller's coordinates.
        let origin = if collider.shape.mesh().is_some() { cloth.origin } else { Vec3::ZERO };
        f64::from(gap(&collider.relative_to(cloth.origin).shape, low + origin, high + origin)) <= reach
    })
}

/// Half the range of the velocities (m/s) of pins and of mesh colliders near the cloth: their largest distance from the
/// midpoint of the range. A common motion of all of them does not count, and of a moving character only the parts that come near
/// the cloth do.
fn kinematic_speed(inputs: LoadInputs<'_>, thickness: f32, whereabouts: Option<Whereabouts>) -> f64 {
    let LoadInputs { cloth, motion, attributes, dt, .. } = inputs;
    let targets = attributes.pin_targets.as_deref().unwrap_or_default();
    let held = (targets.is_empty() && cloth.has_pins()).then_some(Vec3::ZERO);
    let pins = cloth.pinned.iter().zip(targets.iter().zip(&motion.pins)).filter(|(pin, _)| cloth.is_used(**pin));
    let pins = pins.map(|(_, (&to, &from))| to - cloth.origin - from).chain(held);
    let course = motion.course_of_free(cloth) * dt;
    let near = whereabouts.map_or([Vec3::NEG_INFINITY, Vec3::INFINITY], |Whereabouts { low, high, fastest }| {
        let reach = STEPS_AHEAD as f32 * fastest * dt + 2.0 * thickness;
        [low + cloth.origin - reach, high + cloth.origin + reach]
    });
    let mut of_meshes = Vec::new();
    for (now, last) in motion.followed(&attributes.colliders) {
        if let (Some(to), Some(from)) = (now.shape.mesh(), last.shape.mesh()) {
            let moves = || from.positions.iter().zip(&to.positions).map(|(&from, &to)| [from, to - from]);
            let relative = travel(&now.shape, &last.shape, course, None);
            if !is_near(cloth, now, relative + f64::from(thickness), f64::from(dt), whereabouts) {
                continue;
            }
            let enlargement = |by: Vec3| STEPS_AHEAD as f32 * (by - course).abs();
            let is_near = near_vertices(&to.triangles, moves().map(|[from, by]| around([from, by], enlargement(by))), near);
            of_meshes.extend(moves().zip(is_near).filter(|(_, is_near)| *is_near).map(|([_, by], _)| by));
        }
    }
    let moves = || pins.clone().chain(of_meshes.iter().copied());
    let [low, high] = bounds(moves());
    let middle = 0.5 * (low + high);
    f64::from(moves().map(|by| by.distance(middle)).fold(0.0, f32::max)) / f64::from(dt)
}

/// Age in steps that statistics may have on the GPU (three), and one step more until they are updated.
pub(crate) const STEPS_AHEAD: f64 = 4.0;

/// The largest displacement (m) of a point of the surface between `last` and `now`, relative to what moves `by` that much; 0 if
/// the shapes are of different kinds. Of what turns, only the points `within` a box count, if it is known where the cloth is.
pub(crate) fn travel(now: &Shape, last: &Shape, by: Vec3, within: Option<[Vec3; 2]>) -> f64 {
    let apart = |a: Vec3, b: Vec3| a.as_dvec3() - b.as_dvec3() - by.as_dvec3();
    match (now, last) {
        // Motion within the plane only drags by friction, which does not push the cloth.
        (&Shape::Plane { point, normal }, &Shape::Plane { point: p0, normal: n0 }) => {
            let [n0, n] = [n0, normal].map(|normal| normal.as_dvec3().normalize());
            let [low, high] = within.unwrap_or([p0; 2]).map(Vec3::as_dvec3);
            let rise = apart(point, p0).dot(n) - (n - n0).dot(0.5 * (low + high) - p0.as_dvec3());
            rise.abs() + (n - n0).abs().dot(0.5 * (high - low))
        }
        (&Shape::RoundedBox { center, half, rotation, .. }, &Shape::RoundedBox { center: c0, half: h0, rotation: q0, .. }) => {
            // A corner turned by an angle moves along a chord of `2 sin(angle/2)` times its distance; the quaternions
            // differ by `2 sin(angle/4)`.
            let [now, last] = [rotation, q0].map(|rotation| rotation.as_dquat().normalize());
            let turned = 2.0 * (now - last).length().min((now + last).length());
            let farthest = |[low, high]: [Vec3; 2]| (high - c0).abs().max((low - c0).abs()).as_dvec3().length();
            let lever = half.max(h0).as_dvec3().length().min(within.map_or(f64::INFINITY, farthest));
            apart(center, c0).length() + (half.as_dvec3() - h0.as_dvec3()).length() + turned * lever
        }
        (Shape::Mesh { mesh }, Shape::Mesh { mesh: last }) => {
            let moves = mesh.positions.iter().zip(&last.positions).map(|(&to, &from)| (to - from - by).length_squared());
            f64::from(if Arc::ptr_eq(mesh, last) { by.length() } else { moves.fold(0.0, f32::max).sqrt() })
        }
        (Shape::Plane { .. } | Shape::RoundedBox { .. } | Shape::Mesh { .. }, _) => 0.0,
        (Shape::Sphere { .. } | Shape::Capsule { .. } | Shape::TaperedCapsule { .. }, _) => {
            let ends = now.ends().zip(last.ends().filter(|_| discriminant(now) == discriminant(last)));
            let end = |now: (Vec3, f32), last: (Vec3, f32)| apart(now.0, last.0).length() + f64::from((now.1 - last.1).abs());
            ends.map_or(0.0, |(now, last)| end(now[0], last[0]).max(end(now[1], last[1])))
        }
    }
}

/// A lower bound of the distance (m) between a surface and an axis-aligned box.
fn gap(shape: &Shape, low: Vec3, high: Vec3) -> f32 {
    let between = |first: Vec3, last: Vec3| (low - last).max(first - high).max(Vec3::ZERO).length();
    match *shape {
        Shape::Sphere { center, radius } => between(center, center) - radius,
        Shape::Capsule { a, b, radius } => between(a.min(b), a.max(b)) - radius,
        Shape::Plane { point, normal } => {
            let lowest = Vec3::select(normal.cmpge(Vec3::ZERO), low, high);
            (lowest - point).dot(normal.normalize_or_zero())
        }
        Shape::TaperedCapsule { a, radius_a, b, radius_b } => {
            between((a - radius_a).min(b - radius_b), (a + radius_a).max(b + radius_b))
        }
        Shape::RoundedBox { center, half, rotation, .. } => {
            let axes = Mat3::from_quat(rotation.as_dquat().normalize().as_quat());
            let reach = axes.x_axis.abs() * half.x + axes.y_axis.abs() * half.y + axes.z_axis.abs() * half.z;
            between(center - reach, center + reach)
        }
        Shape::Mesh { ref mesh } => {
            let [first, last] = mesh.bounds();
            between(first, last)
        }
    }
}
