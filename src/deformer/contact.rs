//! Requirements of triangle contact on a step, and its warnings.

use super::{Deformer, Taken};
#[cfg(feature = "gpu")]
use crate::attributes::invalid;
use crate::attributes::{Attributes, Shape};
#[cfg(feature = "gpu")]
use crate::device::IN_BROWSER;
use crate::error::StepError;
#[cfg(feature = "gpu")]
use crate::options::Backend;
use crate::options::{Contact, Quality, Warning};
use crate::step::substep_count::FRAMES;

/// Fewest substeps in which pins and mesh vertices may move by the contact thickness; with this many, nothing passes
/// through.
const SUBSTEPS: f64 = 3.0;
/// Most substeps per 1/60 s that contact may raise a step to.
const MOST: f64 = 256.0;

impl Deformer {
    /// The contact thickness (m), or `None` if no triangles can touch in a step.
    #[cfg_attr(not(feature = "gpu"), expect(clippy::unnecessary_wraps, reason = "only a GPU in a browser has no contact"))]
    pub(super) fn contact_thickness(&self, attributes: &Attributes) -> Result<Option<f64>, StepError> {
        let mesh = attributes.colliders.iter().position(|collider| matches!(collider.shape, Shape::Mesh { .. }));
        #[cfg(feature = "gpu")]
        if let (Some(index), Backend::Gpu, true) = (mesh, self.backend(), IN_BROWSER) {
            let remedy = "must wait for the GPU in each step, which a browser does not allow; use Backend::Cpu";
            return Err(invalid(format_args!("colliders[{index}].shape"), "a mesh", remedy));
        }
        let contact = self.options.contact.or_else(|| mesh.map(|_| Contact::default()));
        Ok(contact.map(|contact| f64::from(contact.thickness)))
    }

    /// Substeps per second that contact needs while pins and meshes move at `speed` (m/s); 0 if the quality fixes the
    /// number.
    pub(super) fn resolving_contact(&self, thickness: f64, speed: f64) -> f64 {
        match self.options.quality {
            Quality::Substeps(_) | Quality::Budget(_) => 0.0,
            _ => FRAMES * (SUBSTEPS * speed / thickness / FRAMES).ceil().min(MOST),
        }
    }

    /// The warning that pins or meshes move faster than contact resolves in a step. Without contact their speed is not
    /// looked at.
    pub(super) fn contact_outruns(&self, taken: &Taken) -> Option<Warning> {
        let thickness = self.options.contact.unwrap_or_default().thickness;
        let (speed, resolved) = (taken.load.led_speed as f32, thickness / (SUBSTEPS as f32 * taken.division.length.h));
        (speed > 1.001 * resolved && !self.cloth.triangles.is_empty()).then_some(Warning::ContactOutruns { speed, resolved })
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
            let meshes =
                attributes.colliders.iter().enumerate().filter(|(_, collider)| matches!(collider.shape, Shape::Mesh { .. }));
            let collider = meshes.map(|(index, _)| index).nth(first).unwrap_or_default();
            warnings.push(Warning::BodyCrossings { pairs: bodies.len(), collider });
        }
        warnings
    }
}
