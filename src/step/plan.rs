//! A step as numbers: what follows from attributes, options and the last step, before any engine runs.

use std::sync::Arc;

use glam::Vec3;

use crate::attributes::{Attributes, Collider, Shape};
use crate::kernels::contact::{self, Body};
use crate::kernels::integrate::Pin;
use crate::kernels::params::{Params, Substep};
use crate::kernels::statistics::StrainGauge;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::multigrid::hierarchy::Level;
use crate::options::{Contact, Method, Options};
use crate::step::coefficients::Coefficients;
use crate::step::load::acceleration;
use crate::step::motion::Motion;

/// The buffers of a plan. They are kept from step to step so that a step allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct PlanBuffers {
    substeps: Vec<Substep>,
    /// Colliders, followed by the anchors of tethers.
    bodies: Vec<Body>,
    meshes: Vec<MeshBody>,
    pins: Vec<Pin>,
}

/// A mesh collider, with its vertices at the step's start and end (m, in the caller's coordinates).
#[derive(Debug, Clone)]
pub(crate) struct MeshBody {
    pub from: Arc<Mesh>,
    pub to: Arc<Mesh>,
    pub friction: f32,
}

/// Everything that an engine needs for one step.
#[derive(Debug)]
pub(crate) struct Plan<'a> {
    pub cloth: &'a Cloth,
    /// The coarse levels, finest first. As many are used as `coefficients` has edges for.
    pub levels: &'a [Level],
    pub coefficients: &'a Coefficients,
    pub params: Params,
    pub substeps: &'a [Substep],
    pub bodies: &'a [Body],
    /// `bodies` followed by `anchors`.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only the GPU has them in one list"))]
    pub bodies_and_anchors: &'a [Body],
    /// The pins that tethers are attached to: only their positions and motions.
    pub anchors: &'a [Body],
    /// Mesh colliders; they are not among `bodies`.
    pub meshes: &'a [MeshBody],
    /// The pins that follow targets, sorted by vertex.
    pub pins: &'a [Pin],
    /// Where the step starts for all pins (m, in local coordinates), in the order of [`Cloth::pinned`].
    pub pins_from: &'a [Vec3],
    /// Sweeps over the edges per substep.
    pub sweeps: u32,
    pub method: Method,
    /// The force terms of the scene. Springs are given by `method`.
    pub bending: bool,
    pub wind: bool,
    /// The gauges by which the cloth's strain is measured after the step, if statistics are asked for.
    pub gauges: Option<&'a [StrainGauge]>,
    /// Contact of the cloth with itself, if it is enabled.
    pub contact: Option<Contact>,
    /// On the CPU: use only this thread, because others step cloths of their own.
    pub alone: bool,
}

impl<'a> Plan<'a> {
    /// Turns attributes into the numbers that the kernels take. `motion` is where the last step left off, `count` the
    /// number of substeps.
    #[expect(clippy::too_many_arguments, reason = "all that a step follows from, and the buffers that it is written to")]
    pub(crate) fn new(
        cloth: &'a Cloth,
        levels: &'a [Level],
        options: &Options,
        coefficients: &'a Coefficients,
        motion: &'a Motion,
        count: u32,
        attributes: &Attributes,
        buffers: &'a mut PlanBuffers,
    ) -> Plan<'a> {
        let h = coefficients.length.h;
        let drag = f64::from(attributes.damping);
        // The kick lasts from the middle of the last substep to the middle of this one, and is exact for linear drag.
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
        buffers.meshes.clear();
        for (now, last) in motion.followed(&attributes.colliders) {
            if let (Shape::Mesh { mesh: to }, Shape::Mesh { mesh: from }) = (&now.shape, &last.shape) {
                buffers.meshes.push(MeshBody { from: Arc::clone(from), to: Arc::clone(to), friction: now.friction });
            } else {
                buffers.bodies.push(body(now, last, cloth.origin, cloth.longest));
            }
        }
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
            substeps: count,
            sweeps,
            relaxed: u32::from(matches!(options.method, Method::Relaxation { .. })),
            levels: coefficients.levels.len() as u32,
            // A chain has no width across which coarse edges could pull it together.
            holds: u32::from(!bending && cloth.is_sheet),
            edges: cloth.swept().len() as u32,
            tethers: u32::from(!coefficients.tethers.is_empty()),
            load: acceleration(cloth, attributes) as f32,
            checks: 1,
            // No limit is set until [`Watch`](crate::step::watch::Watch) sets one.
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
            meshes: &buffers.meshes,
            pins: &buffers.pins,
            pins_from: &motion.pins,
            sweeps,
            method: options.method,
            bending,
            wind,
            gauges: None,
            contact: options.contact,
            alone: false,
        }
    }

    /// The same step with statistics after it.
    pub(crate) fn observed(self, motion: &Motion, dt: f32, attributes: &Attributes) -> Plan<'a> {
        let targets = attributes.pin_targets.as_deref().unwrap_or_default();
        let led: Vec3 = targets.iter().zip(&motion.pins).map(|(&target, &pin)| target - self.cloth.origin - pin).sum();
        let drift = led / targets.len().max(1) as f32 * (self.params.h / dt);
        Plan { gauges: Some(self.cloth.gauges()), params: Params { drift: drift.to_array(), ..self.params }, ..self }
    }

    /// Whether triangles can touch: the cloth's own, or those of mesh colliders.
    pub(crate) fn has_contact(&self) -> bool {
        self.contact.is_some() || !self.meshes.is_empty()
    }

    /// Whether forces act that differ from vertex to vertex. A new kind of force must be added here.
    #[cfg(feature = "gpu")]
    pub(crate) fn has_forces(&self) -> bool {
        self.bending || self.wind || self.method == Method::Springs
    }

    /// Whether coarse edges also push (`distance::hold_coarse`).
    pub(crate) fn holds(&self) -> bool {
        self.params.holds != 0
    }

    /// Whether bending is damped.
    pub(crate) fn damped(&self) -> bool {
        self.params.damped != 0
    }
}

/// A collider as the kernels take it, moving from `last` to `now` during the step. Round surfaces are enlarged by 1.2
/// times the sagitta `l²/8R` of the longest edge, the depth to which it would cut into them between its ends.
fn body(now: &Collider, last: &Collider, origin: Vec3, longest: f32) -> Body {
    let (shape, last) = (now.relative_to(origin).shape, last.relative_to(origin).shape);
    // A sharp edge (radius 0) is not enlarged.
    let sagitta = |radius: f32| if radius > 0.0 { 1.2 * longest.min(radius).powi(2) / (8.0 * radius) } else { 0.0 };
    // From the two ends with their radii, at the step's start and end. A sphere has the same end twice.
    let round = |from: [(Vec3, f32); 2], to: [(Vec3, f32); 2]| {
        let [from_radii, to_radii] = [from, to].map(|ends| ends.map(|(_, radius)| radius + sagitta(radius)));
        let [from_taper, to_taper] = [from_radii, to_radii].map(|[a, b]| b - a);
        Body {
            a: from[0].0.to_array(),
            radius: from_radii[0],
            b: from[1].0.to_array(),
            friction: now.friction,
            a_travel: (to[0].0 - from[0].0).to_array(),
            radius_travel: to_radii[0] - from_radii[0],
            b_travel: (to[1].0 - from[1].0).to_array(),
            kind: contact::ROUND,
            c: [from_taper, 0.0, 0.0, 0.0],
            c_travel: [to_taper - from_taper, 0.0, 0.0, 0.0],
        }
    };
    match (shape, last) {
        (Shape::Sphere { center: to, radius: r1 }, Shape::Sphere { center: from, radius: r0 }) => {
            round([(from, r0); 2], [(to, r1); 2])
        }
        (Shape::Capsule { a, b, radius }, Shape::Capsule { a: a0, b: b0, radius: r0 }) => {
            round([(a0, r0), (b0, r0)], [(a, radius), (b, radius)])
        }
        (
            Shape::TaperedCapsule { a, radius_a, b, radius_b },
            Shape::TaperedCapsule { a: a0, radius_a: ra0, b: b0, radius_b: rb0 },
        ) => round([(a0, ra0), (b0, rb0)], [(a, radius_a), (b, radius_b)]),
        (Shape::Plane { point, normal }, Shape::Plane { point: from, .. }) => {
            // Without friction only a plane's motion along its normal has an effect. A rotation of the plane is applied
            // at once.
            Body {
                a: from.to_array(),
                b: normal.as_dvec3().normalize().as_vec3().to_array(),
                friction: now.friction,
                a_travel: (point - from).to_array(),
                kind: contact::PLANE,
                ..Body::default()
            }
        }
        (
            Shape::RoundedBox { center, half, rotation, radius },
            Shape::RoundedBox { center: from, half: half0, rotation: rotation0, radius: radius0 },
        ) => {
            let [first, to] = [rotation0, rotation].map(|rotation| rotation.as_dquat().normalize());
            // Each rotation has two quaternions; interpolate to the nearer one.
            let to = if first.dot(to) < 0.0 { -to } else { to };
            let (core0, core) = (half0 - radius0, half - radius);
            let [edge0, edge] = [radius0, radius].map(|radius| radius + sagitta(radius));
            Body {
                a: from.to_array(),
                radius: edge0,
                b: core0.to_array(),
                friction: now.friction,
                a_travel: (center - from).to_array(),
                radius_travel: edge - edge0,
                b_travel: (core - core0).to_array(),
                kind: contact::BOX,
                c: first.as_quat().to_array(),
                c_travel: (to - first).as_quat().to_array(),
            }
        }
        // The kind of shape changed, so there is no motion to interpolate.
        _ => body(now, now, origin, longest),
    }
}
