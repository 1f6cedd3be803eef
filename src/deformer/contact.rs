//! Requirements of triangle contact on a step, and its warnings.

use std::fmt;

use glam::Vec3;

use super::Deformer;
use super::decision::StepDecision;
use crate::attributes::{Attributes, invalid};
#[cfg(feature = "gpu")]
use crate::device::IN_BROWSER;
use crate::error::StepError;
use crate::model::checks::MAX_THICKNESS;
#[cfg(feature = "gpu")]
use crate::options::Backend;
use crate::options::{Contact, Method, Quality, Warning};
use crate::step::load::travel;
use crate::step::substep_count::SIXTIETHS;

/// Fewest substeps in which pins and mesh vertices may move by the contact thickness; with this many, nothing passes
/// through.
const SUBSTEPS_PER_THICKNESS: f64 = 3.0;
/// Fewest substeps per 1/60 s of cloth without pins, in contact with itself, that is to fall asleep: with the 5 to 7 that the strain
/// of a heap needs, it trembles. Of 32 heaps 7 were awake after 15 s then, and one with these. A garment comes to rest with few.
const SETTLING_SUBSTEPS: f64 = 16.0;
/// Farthest that pins and mesh colliders may move in a step, in units of the cloth's size. Cloth that is torn along farther, as by
/// a teleport without [`Deformer::warp`], stays stretched over itself for seconds, in each of which contact takes seconds.
const MAX_TRAVEL: f64 = 100.0;
/// Most substeps per 1/60 s that contact may raise a step to.
const MAX_CONTACT_SUBSTEPS: f64 = 256.0;

impl Deformer {
    /// The contact thickness (m), or `None` if no triangles can touch in a step.
    #[cfg_attr(not(feature = "gpu"), expect(clippy::unnecessary_wraps, reason = "only a GPU in a browser has no contact"))]
    pub(super) fn contact_thickness(&self, attributes: &Attributes) -> Result<Option<f64>, StepError> {
        let mesh = mesh_colliders(attributes).next();
        #[cfg(feature = "gpu")]
        if let (Some(index), Backend::Gpu, true) = (mesh, self.backend(), IN_BROWSER) {
            let remedy = "must wait for the GPU in each step, which a browser does not allow; use Backend::Cpu";
            return Err(invalid(format_args!("colliders[{index}].mesh"), "a mesh", remedy));
        }
        let contact = self.options.contact.or_else(|| mesh.map(|_| Contact::default()));
        let contact = contact.filter(|_| self.cloth.is_sheet);
        Ok(contact.map(|contact| f64::from(contact.thickness)))
    }

    /// Checks that contact of this thickness (m) can hold the cloth, and follow the pins and mesh colliders.
    pub(super) fn check_contact(&self, attributes: &Attributes, thickness: f64) -> Result<(), StepError> {
        let (cloth, motion) = (&self.cloth, &self.state.motion);
        let across = cloth.sides.max_element() as f32;
        // A thickness that was chosen was compared with the cloth when the cloth was made.
        if let (Some(index), true) =
            (mesh_colliders(attributes).next(), across > 0.0 && thickness > MAX_THICKNESS * f64::from(across))
        {
            let remedy = format!(
                "is kept {} m away, which must be at most half of the cloth's {across} m; make the cloth with Options::contact",
                thickness as f32
            );
            return Err(invalid(format_args!("colliders[{index}].mesh"), "a mesh", remedy));
        }
        let size = cloth.sides.length().max(thickness);
        let check = |name: fmt::Arguments<'_>, value: &dyn fmt::Display, way: f64, remedy: &str| {
            if way > MAX_TRAVEL * size {
                Err(invalid(
                    name,
                    value,
                    format_args!(
                        "is {} m from where it was before the step, more than {MAX_TRAVEL} times the cloth's size of {} m; lead it there in more steps, or {remedy}",
                        way as f32, size as f32
                    ),
                ))
            } else {
                Ok(())
            }
        };
        let pins = attributes.pin_targets.iter().flatten().zip(&motion.pins).enumerate();
        for (slot, (&to, &from)) in pins.filter(|(slot, _)| cloth.is_used(cloth.pinned[*slot])) {
            let way = (to - cloth.origin).as_dvec3().distance(from.as_dvec3());
            check(format_args!("pin_targets[{slot}]"), &to, way, "move the whole cloth with Deformer::warp")?;
        }
        for (index, (now, last)) in motion.followed(&attributes.colliders).enumerate() {
            if now.shape.mesh().is_some() {
                let way = travel(&now.shape, &last.shape, Vec3::ZERO, None);
                check(format_args!("colliders[{index}].mesh"), &"a vertex", way, "say that it was teleported")?;
            }
        }
        Ok(())
    }

    /// Substeps per second that contact needs while pins and meshes move at `speed` (m/s), and to come to rest; 0 if the quality
    /// fixes the number.
    pub(super) fn resolving_contact(&self, thickness: f64, speed: f64) -> f64 {
        match self.options.quality {
            Quality::Substeps(_) | Quality::Budget(_) => 0.0,
            _ => {
                let sleeps = self.options.method == Method::SmallSteps && self.options.contact.and(self.options.sleep).is_some();
                let settles = sleeps && !self.cloth.has_pins();
                let settling = if settles { SETTLING_SUBSTEPS } else { 0.0 };
                SIXTIETHS
                    * (SUBSTEPS_PER_THICKNESS * speed / thickness / SIXTIETHS).ceil().min(MAX_CONTACT_SUBSTEPS).max(settling)
            }
        }
    }

    /// The warning that pins or meshes move faster than contact resolves in a step. Without contact their speed is not
    /// looked at.
    pub(super) fn contact_outruns(&self, decision: &StepDecision) -> Option<Warning> {
        let thickness = self.options.contact.unwrap_or_default().thickness;
        let (speed, resolved) = (
            decision.expected.load.kinematic_speed as f32,
            thickness / (SUBSTEPS_PER_THICKNESS as f32 * decision.expected.length.h),
        );
        (speed > 1.001 * resolved).then_some(Warning::ContactOutruns { speed, resolved })
    }

    /// The warnings of what contact found in a step.
    pub(super) fn contact_warnings(&self, attributes: &Attributes) -> Vec<Warning> {
        let mut warnings = Vec::new();
        if self.engine.contact().is_none() {
            return warnings;
        }
        let (crossings, bodies) = self.engine.crossings();
        if let Some(&first) = crossings.first() {
            warnings.push(Warning::Crossings { pairs: crossings.len(), first: first.named(&self.cloth.order) });
        }
        if let Some(&first) = bodies.first() {
            let collider = mesh_colliders(attributes).nth(first).unwrap_or_default();
            warnings.push(Warning::BodyCrossings { pairs: bodies.len(), collider });
        }
        warnings
    }
}

/// The indices of mesh colliders.
pub(super) fn mesh_colliders(attributes: &Attributes) -> impl Iterator<Item = usize> {
    (0..).zip(&attributes.colliders).filter(|(_, collider)| collider.shape.mesh().is_some()).map(|(index, _)| index)
}
