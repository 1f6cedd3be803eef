//! A step as numbers: what attributes, options and the last step come to, before any engine runs.

use glam::Vec3;

use crate::attributes::{Attributes, Collider, Shape};
use crate::kernels::contact::{self, Body};
use crate::kernels::integrate::Pin;
use crate::kernels::params::{Params, Substep};
use crate::kernels::statistics::StrainGauge;
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::Level;
use crate::options::{Contact, Method, Options};
use crate::step::coefficients::Coefficients;
use crate::step::load::acceleration;
use crate::step::motion::Motion;

/// The buffers of a plan, kept from step to step so that a step allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct PlanBuffers {
    substeps: Vec<Substep>,
    /// Colliders, and behind them the anchors of tethers.
    bodies: Vec<Body>,
    pins: Vec<Pin>,
}

/// All that an engine needs for one step.
#[derive(Debug)]
pub(crate) struct Plan<'a> {
    pub cloth: &'a Cloth,
    /// The coarse levels in use, the finest first.
    pub levels: &'a [Level],
    pub coefficients: &'a Coefficients,
    pub params: Params,
    pub substeps: &'a [Substep],
    pub bodies: &'a [Body],
    /// The same, and behind them the pins that tethers hang on: points that travel.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only the GPU has them in one list"))]
    pub bodies_and_anchors: &'a [Body],
    pub anchors: &'a [Body],
    /// In the order of their vertices.
    pub pins: &'a [Pin],
    /// Sweeps over the edges in each substep.
    pub sweeps: u32,
    pub method: Method,
    /// The force terms that the scene has; springs are the method.
    pub bending: bool,
    pub wind: bool,
    /// By what the cloth's strain and speed are told after the step, if they are asked for.
    pub gauges: Option<&'a [StrainGauge]>,
    /// Contact of the cloth with itself.
    pub contact: Option<Contact>,
}

impl<'a> Plan<'a> {
    /// Turns attributes into the numbers the kernels take. `motion` is where the last step left off.
    #[expect(clippy::too_many_arguments, reason = "all that a step follows from, and the buffers that it is written to")]
    pub(crate) fn new(
        cloth: &'a Cloth,
        levels: &'a [Level],
        options: &Options,
        coefficients: &'a Coefficients,
        motion: &Motion,
        count: u32,
        attributes: &Attributes,
        buffers: &'a mut PlanBuffers,
    ) -> Plan<'a> {
        let h = coefficients.length.h;
        let drag = f64::from(attributes.damping);
        // The kick spans from the middle of the last substep to the middle of this one; exact for linear drag.
        let substep = |index: u32| {
            let (last, unit) = if index == 0 { (motion.h, motion.unit()) } else { (h, h) };
            let kick = 0.5 * (f64::from(last) + f64::from(h));
            let gain = if drag > 0.0 { -(-drag * kick).exp_m1() / drag } else { kick };
            Substep {
                carry: ((-drag * kick).exp() * f64::from(h) / f64::from(unit)) as f32,
                gain: (gain * f64::from(h)) as f32,
                rate: 1.0 / unit,
                start: index as f32 / count as f32,
                end: (index + 1) as f32 / count as f32,
            }
        };
        buffers.bodies.clear();
        let followed = motion.followed(&attributes.colliders);
        buffers.bodies.extend(followed.map(|(now, last)| body(now, last, cloth.origin, cloth.longest)));
        let bodies = buffers.bodies.len();
        if let Some(tethers) = cloth.tethers.as_ref().filter(|_| !coefficients.tethers.is_empty()) {
            let anchor = |&place: &u32| {
                let from = motion.pins[place as usize];
                let to = attributes.pin_targets.as_ref().map_or(from, |targets| targets[place as usize] - cloth.origin);
                Body { a: from.to_array(), a_travel: (to - from).to_array(), ..Body::default() }
            };
            buffers.bodies.extend(tethers.anchors.iter().map(anchor));
        }
        let targets = attributes.pin_targets.iter().flatten();
        let pin = |((&to, from), &vertex): ((&Vec3, &Vec3), &u32)| Pin {
            origin: from.to_array(),
            vertex,
            goal: (to - cloth.origin).to_array(),
            padding: 0,
        };
        buffers.pins.clear();
        buffers.pins.extend(targets.zip(&motion.pins).zip(&cloth.pinned).map(pin));
        buffers.pins.sort_unstable_by_key(|pin| pin.vertex);
        buffers.substeps.clear();
        buffers.substeps.extend((0..count).map(substep));
        let (bending, wind) = (options.fabric.bending > 0.0, attributes.air_density > 0.0);
        let sweeps = match options.method {
            Method::SmallSteps => 1,
            Method::Relaxation { iterations } => iterations,
            Method::Springs => 0,
        };
        let params = Params {
            acceleration: (attributes.gravity + attributes.damping * attributes.wind).to_array(),
            h,
            wind: attributes.wind.to_array(),
            half_density: 0.5 * attributes.air_density,
            drag: attributes.drag,
            lift: attributes.lift,
            fraction: 1.0 / count as f32,
            vertices: cloth.rest.len() as u32,
            bodies: bodies as u32,
            pins: buffers.pins.len() as u32,
            damped: u32::from(options.fabric.damping > 0.0),
            predicted: u32::from(has_forces(bending, wind, options.method) || !buffers.pins.is_empty()),
            substeps: count,
            sweeps,
            relaxed: u32::from(matches!(options.method, Method::Relaxation { .. })),
            levels: coefficients.levels.len() as u32,
            // A thread has no width across which anything could pull it together.
            holds: u32::from(!bending && cloth.is_sheet),
            edges: cloth.swept().len() as u32,
            tethers: u32::from(!coefficients.tethers.is_empty()),
            load: acceleration(cloth, attributes) as f32,
            // Nothing is too fast or too long until [`Watch`](crate::step::watch::Watch) says so.
            longest: f32::MAX,
            ..Params::default()
        };
        Plan {
            cloth,
            levels,
            coefficients,
            params,
            substeps: &buffers.substeps,
            bodies: &buffers.bodies[..bodies],
            bodies_and_anchors: &buffers.bodies,
            anchors: &buffers.bodies[bodies..],
            pins: &buffers.pins,
            sweeps,
            method: options.method,
            bending,
            wind,
            gauges: None,
            contact: options.contact,
        }
    }

    /// The same step, after which statistics are asked for.
    pub(crate) fn observed(self, motion: &Motion, dt: f32, attributes: &Attributes) -> Plan<'a> {
        let targets = attributes.pin_targets.as_deref().unwrap_or_default();
        let led: Vec3 = targets.iter().zip(&motion.pins).map(|(&target, &pin)| target - self.cloth.origin - pin).sum();
        let drift = led / targets.len().max(1) as f32 * (self.params.h / dt);
        Plan { gauges: Some(self.cloth.gauges()), params: Params { drift: drift.to_array(), ..self.params }, ..self }
    }

    /// Whether there are forces that differ from vertex to vertex.
    #[cfg(feature = "gpu")]
    pub(crate) fn has_forces(&self) -> bool {
        has_forces(self.bending, self.wind, self.method)
    }

    /// Whether coarse edges hold.
    pub(crate) fn holds(&self) -> bool {
        self.params.holds != 0
    }

    /// Whether bending is damped.
    pub(crate) fn damped(&self) -> bool {
        self.params.damped != 0
    }
}

/// The forces that differ from vertex to vertex: a new one is named here.
fn has_forces(bending: bool, wind: bool, method: Method) -> bool {
    bending || wind || method == Method::Springs
}

/// A collider as the kernels take it, moving here from `last` during the step. A round body is made larger by what
/// the longest edge sinks between its ends, a fifth more than its sagitta `l²/8R`.
fn body(now: &Collider, last: &Collider, origin: Vec3, longest: f32) -> Body {
    let (shape, last) = (now.relative_to(origin).shape, last.relative_to(origin).shape);
    let round = |from: (Vec3, Vec3, f32), to: (Vec3, Vec3, f32)| {
        let [from_radius, to_radius] = [from.2, to.2].map(|radius| radius + 1.2 * longest.min(radius).powi(2) / (8.0 * radius));
        Body {
            a: from.0.to_array(),
            radius: from_radius,
            b: from.1.to_array(),
            friction: now.friction,
            a_travel: (to.0 - from.0).to_array(),
            radius_travel: to_radius - from_radius,
            b_travel: (to.1 - from.1).to_array(),
            kind: contact::ROUND,
        }
    };
    match (shape, last) {
        (Shape::Sphere { center: to, radius: r1 }, Shape::Sphere { center: from, radius: r0 }) => {
            round((from, from, r0), (to, to, r1))
        }
        (Shape::Capsule { a, b, radius }, Shape::Capsule { a: a0, b: b0, radius: r0 }) => round((a0, b0, r0), (a, b, radius)),
        (Shape::Plane { point, normal }, Shape::Plane { point: from, .. }) => {
            // Only its motion along the normal can be felt without friction; a plane that turns does so at once.
            Body {
                a: from.to_array(),
                b: normal.as_dvec3().normalize().as_vec3().to_array(),
                friction: now.friction,
                a_travel: (point - from).to_array(),
                kind: contact::PLANE,
                ..Body::default()
            }
        }
        // Another shape in its place: nothing it moved from.
        (Shape::Sphere { center, radius }, _) => round((center, center, radius), (center, center, radius)),
        (Shape::Capsule { a, b, radius }, _) => round((a, b, radius), (a, b, radius)),
        (Shape::Plane { .. }, _) => body(now, now, origin, longest),
    }
}
