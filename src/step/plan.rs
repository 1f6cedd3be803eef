//! A step as numbers: what follows from attributes, options and the last step, before any engine runs.

use std::sync::Arc;

use glam::Vec3;

use crate::attributes::Attributes;
use crate::kernels::contact::Body;
use crate::kernels::contact::near::Clear;
use crate::kernels::distance::{SLACK_BAND, SLACK_BAND_OF_FEW};
use crate::kernels::integrate::Pin;
use crate::kernels::params::{Params, Substep};
use crate::kernels::statistics::StrainGauge;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::multigrid::hierarchy::Level;
use crate::options::{Contact, Method, Options};
use crate::step::bodies::moving;
use crate::step::coefficients::Coefficients;
use crate::step::levels::coarse_rule;
use crate::step::load::loading_acceleration;
use crate::step::motion::{Ambient, Motion, Whereabouts};

/// What a step follows from.
#[derive(Clone, Copy)]
pub(crate) struct StepInputs<'a> {
    pub cloth: &'a Cloth,
    /// The coarse levels, finest first.
    pub levels: &'a [Level],
    /// Whether fewer levels are asked for than carry the load, although there may be no more.
    pub lacks_levels: bool,
    pub options: &'a Options,
    pub coefficients: &'a Coefficients,
    /// Where the last step left off.
    pub motion: &'a Motion,
    /// The number of substeps.
    pub substeps: u32,
    pub attributes: &'a Attributes,
}

/// The buffers of a plan. They are kept from step to step so that a step allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct PlanBuffers {
    substeps: Vec<Substep>,
    /// Colliders, followed by the anchors of tethers.
    bodies: Vec<Body>,
    clear_in_step: Vec<Clear>,
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
pub(crate) struct Plan<'a> {
    pub cloth: &'a Cloth,
    /// The coarse levels, finest first. As many are used as `coefficients` has edges for.
    pub levels: &'a [Level],
    pub coefficients: &'a Coefficients,
    pub params: Params,
    pub substeps: &'a [Substep],
    pub bodies: &'a [Body],
    /// Where each of them cannot be touched in the step.
    pub clear_in_step: &'a [Clear],
    /// `bodies` followed by `anchors`.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only the GPU has them in one list"))]
    pub bodies_and_anchors: &'a [Body],
    /// The pins that tethers are attached to: only their positions and motions.
    pub anchors: &'a [Body],
    /// Mesh colliders; they are not among `bodies`.
    pub meshes: &'a [MeshBody],
    /// Where the cloth may be, as far as that is known without reading it from a GPU.
    pub whereabouts: Option<Whereabouts>,
    /// The pins that follow targets, sorted by vertex.
    pub pins: &'a [Pin],
    /// Where the step starts for all pins (m, in local coordinates), in the order of [`Cloth::pinned`].
    pub pins_from: &'a [Vec3],
    pub method: Method,
    /// The force terms of the scene; air resists also where no wind blows. Springs are given by `method`.
    pub bending: bool,
    pub air: bool,
    /// The gauges by which the cloth's strain is measured after the step, if statistics are asked for.
    pub gauges: Option<&'a [StrainGauge]>,
    /// Contact of the cloth with itself, if it is enabled.
    pub contact: Option<Contact>,
    /// Which pairs contact lists on the CPU.
    pub listing: Listing,
    /// On the CPU: use only this thread, because others step cloths of their own.
    pub alone: bool,
}

/// Which pairs contact lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Listing {
    /// Those that may meet while contact changes the ways of vertices little.
    Expected,
    /// All that may meet wherever on their ways it stops vertices, which are several times as many.
    EveryStop,
}

impl StepInputs<'_> {
    /// Substep number `index`.
    fn substep(&self, index: u32) -> Substep {
        let h = self.coefficients.length.h;
        let ambient = Ambient::of(self.attributes);
        let (last, unit, before) = if index == 0 {
            (self.motion.h, self.motion.unit(), self.motion.ambient.unwrap_or(ambient))
        } else {
            (h, h, ambient)
        };
        // The kick lasts from the middle of the last substep, which may belong to another step, to the middle of this one. It is exact for
        // linear drag.
        let length = f64::from(h);
        let ([decay_before, gain_before], [decay, gain]) =
            (before.decay_and_gain(0.5 * f64::from(last)), ambient.decay_and_gain(0.5 * length));
        let (gain_before, gain) = (gain_before * decay * length, gain * length);
        let fall = ambient.acceleration * (gain_before + gain) as f32
            + (before.acceleration - ambient.acceleration) * gain_before as f32;
        Substep {
            fall: fall.to_array(),
            carry: (decay_before * decay * length / f64::from(unit)) as f32,
            gain: (gain_before + gain) as f32,
            rate: 1.0 / unit,
            start: index as f32 / self.substeps as f32,
            end: (index + 1) as f32 / self.substeps as f32,
        }
    }

    /// What is the same in all substeps, but for the numbers of bodies and pins.
    fn params(&self) -> Params {
        let StepInputs { cloth, options, coefficients, attributes, .. } = *self;
        let dt = coefficients.length.h * self.substeps as f32;
        let drift = self.motion.drift(cloth, attributes.pin_targets.as_deref(), dt) / self.substeps as f32;
        Params {
            h: coefficients.length.h,
            wind: attributes.wind.to_array(),
            half_density: 0.5 * attributes.air_density,
            drag: attributes.drag,
            lift: attributes.lift,
            fraction: 1.0 / self.substeps as f32,
            vertices: cloth.rest.len() as u32,
            used: cloth.used as u32,
            damped: u32::from(options.fabric.damping > 0.0),
            substeps: self.substeps,
            sweeps: match options.method {
                Method::SmallSteps => 1,
                Method::Relaxation { iterations } => iterations,
                Method::Springs => 0,
            },
            relaxed: u32::from(matches!(options.method, Method::Relaxation { .. })),
            levels: coefficients.levels.len() as u32,
            coarse_rule: coarse_rule(cloth, options),
            per_slack: 1.0
                / if self.lacks_levels && coefficients.levels.len() < self.levels.len() { SLACK_BAND_OF_FEW } else { SLACK_BAND },
            edges: cloth.swept().len() as u32,
            tethers: u32::from(!coefficients.tethers.is_empty()),
            drift: drift.to_array(),
            load: loading_acceleration(cloth, attributes, drift / coefficients.length.h) as f32,
            checks: 1,
            up: (-attributes.gravity.as_dvec3().normalize_or_zero()).as_vec3().to_array(),
            // No limit is set until [`Watch`](crate::step::watch::Watch) sets one.
            longest_edge: f32::MAX,
            ..Params::default()
        }
    }
}

impl PlanBuffers {
    fn set_colliders(&mut self, inputs: &StepInputs<'_>) {
        self.bodies.clear();
        self.meshes.clear();
        for (now, last) in inputs.motion.followed(&inputs.attributes.colliders) {
            if let (Some(to), Some(from)) = (now.shape.mesh(), last.shape.mesh()) {
                self.meshes.push(MeshBody { from: Arc::clone(from), to: Arc::clone(to), friction: now.friction });
            } else {
                self.bodies.push(moving(now, last, inputs.cloth));
            }
        }
        self.clear_in_step.clear();
        self.clear_in_step.extend(self.bodies.iter().map(Clear::in_step));
    }

    /// Adds the pins that tethers are attached to, if tethers are in use, to the colliders.
    fn add_anchors(&mut self, inputs: &StepInputs<'_>) {
        let StepInputs { cloth, coefficients, motion, attributes, .. } = *inputs;
        let tethers = cloth.tethers.as_ref().filter(|_| !coefficients.tethers.is_empty());
        self.bodies.extend(tethers.iter().flat_map(|tethers| &tethers.anchors).map(|&place| {
            let from = motion.pins[place as usize];
            let to = attributes.pin_targets.as_ref().map_or(from, |targets| targets[place as usize] - cloth.origin);
            Body { a: from.to_array(), a_travel: (to - from).to_array(), ..Body::default() }
        }));
    }

    fn set_pins(&mut self, inputs: &StepInputs<'_>) {
        let StepInputs { cloth, motion, attributes, .. } = *inputs;
        let targets = attributes.pin_targets.iter().flatten();
        self.pins.clear();
        self.pins.extend(targets.zip(&motion.pins).zip(&cloth.pinned).map(|((&to, from), &vertex)| Pin {
            origin: from.to_array(),
            vertex,
            goal: (to - cloth.origin).to_array(),
            padding: 0,
        }));
        self.pins.sort_unstable_by_key(|pin| pin.vertex);
    }
}

impl<'a> Plan<'a> {
    /// Turns what a step follows from into the numbers that the kernels take.
    pub(crate) fn new(inputs: &StepInputs<'a>, buffers: &'a mut PlanBuffers) -> Plan<'a> {
        let StepInputs { cloth, levels, options, coefficients, motion, .. } = *inputs;
        buffers.substeps.clear();
        buffers.substeps.extend((0..inputs.substeps).map(|index| inputs.substep(index)));
        buffers.set_colliders(inputs);
        let colliders = buffers.bodies.len();
        buffers.add_anchors(inputs);
        buffers.set_pins(inputs);
        let (bodies, anchors) = buffers.bodies.split_at(colliders);
        let params = Params { bodies: bodies.len() as u32, pins: buffers.pins.len() as u32, ..inputs.params() };
        Plan {
            cloth,
            levels,
            coefficients,
            params,
            substeps: &buffers.substeps,
            bodies,
            clear_in_step: &buffers.clear_in_step,
            bodies_and_anchors: &buffers.bodies,
            anchors,
            meshes: &buffers.meshes,
            whereabouts: None,
            pins: &buffers.pins,
            pins_from: &motion.pins,
            method: options.method,
            bending: inputs.options.fabric.bending > 0.0,
            air: inputs.attributes.air_density > 0.0,
            gauges: None,
            contact: options.contact.filter(|_| inputs.cloth.is_sheet),
            listing: Listing::Expected,
            alone: false,
        }
    }

    /// The same step with statistics after it.
    pub(crate) fn observed(self) -> Plan<'a> {
        Plan { gauges: Some(self.cloth.gauges()), ..self }
    }

    /// The same step without analytic colliders.
    pub(crate) fn without_bodies(&self) -> Plan<'a> {
        Plan { bodies: &[], bodies_and_anchors: self.anchors, params: Params { bodies: 0, ..self.params }, ..*self }
    }

    /// Whether triangles can touch: the cloth's own, or those of mesh colliders.
    pub(crate) fn has_contact(&self) -> bool {
        self.contact.is_some() || !self.meshes.is_empty()
    }

    /// Whether forces act that differ from vertex to vertex. A new kind of force must be added here.
    pub(crate) fn has_forces(&self) -> bool {
        self.bending || self.air || self.method == Method::Springs
    }

    /// Whether any of them depends on velocities; a new one must be added here, too.
    #[cfg(feature = "gpu")]
    pub(crate) fn forces_read_velocities(&self) -> bool {
        self.air || self.bending && self.damped()
    }

    /// Whether bending is damped.
    pub(crate) fn damped(&self) -> bool {
        self.params.damped != 0
    }
}

#[cfg(test)]
#[path = "../../tests/unit/step_plan.rs"]
mod tests;
