//! Requirements of triangle contact on a step, and its warnings.

use super::{Deformer, Taken};
use crate::attributes::{Attributes, Shape, invalid};
#[cfg(feature = "gpu")]
use crate::backend::Engine;
#[cfg(feature = "gpu")]
use crate::cpu::Cpu;
use crate::error::StepError;
use crate::options::{Backend, Contact, Quality, Warning};
#[cfg(feature = "gpu")]
use crate::past::Past;
use crate::step::substep_count::FRAMES;

/// Fewest substeps in which pins and mesh vertices may move by the contact thickness; with this many, nothing passes
/// through.
const SUBSTEPS: f64 = 3.0;
/// Most substeps per 1/60 s that contact may raise a step to.
const MOST: f64 = 256.0;

impl Deformer {
    /// Moves the cloth from the GPU to the CPU if the backend was left to the library and a mesh collider appears: the GPU
    /// does not support mesh colliders yet.
    #[cfg(feature = "gpu")]
    pub(super) fn leave_the_gpu_for_meshes(&mut self, attributes: &Attributes) -> Result<(), StepError> {
        let has_mesh = attributes.colliders.iter().any(|collider| matches!(collider.shape, Shape::Mesh { .. }));
        if !has_mesh || self.options.backend != Backend::Auto || self.backend() != Backend::Gpu {
            return Ok(());
        }
        self.positions()?;
        let mut cpu = Cpu::new(&self.cloth);
        let mut steps = [0; 2];
        let read = self.engine.past().map(|past| steps = past.steps);
        let read = read.and_then(|()| {
            self.engine.read(|x, p| {
                let past = Past { steps, ..Past::default() };
                cpu.resume(&self.cloth, self.options.contact, [x, p], &past);
            })
        });
        read.map_err(|failure| self.failed(failure))?;
        self.engine = Engine::Cpu(Box::new(cpu));
        // Statistics of the GPU's last steps will not arrive any more.
        self.unjudged.clear();
        Ok(())
    }

    /// The contact thickness (m), or `None` if no triangles can touch in a step.
    pub(super) fn contact_thickness(&self, attributes: &Attributes) -> Result<Option<f64>, StepError> {
        let mesh = attributes.colliders.iter().position(|collider| matches!(collider.shape, Shape::Mesh { .. }));
        if let (Some(index), Backend::Gpu) = (mesh, self.backend()) {
            let remedy = "can collide with cloth only on the CPU so far; use Backend::Cpu or Hybrid";
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

    /// The warnings of contact after a step.
    pub(super) fn contact_warnings(&self, taken: &Taken, attributes: &Attributes) -> Vec<Warning> {
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
        let thickness = self.options.contact.unwrap_or_default().thickness;
        let (speed, resolved) = (taken.load.led_speed as f32, thickness / (SUBSTEPS as f32 * taken.division.length.h));
        if speed > 1.001 * resolved {
            warnings.push(Warning::ContactOutruns { speed, resolved });
        }
        warnings
    }
}

#[cfg(all(test, feature = "gpu"))]
#[path = "../../tests/unit/deformer_contact.rs"]
mod tests;
