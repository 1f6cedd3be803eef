//! What options may be, as far as it does not depend on the mesh.

use crate::error::BuildError;
use crate::kernels::limits::{MAX_POSITION, MAX_SUBSTEPS};
use crate::kernels::statistics::SLOW;
use crate::options::{Contact, Method, Options, Quality};

impl Options {
    /// Checks everything that does not depend on the mesh.
    pub(crate) fn check_numbers(&self) -> Result<(), BuildError> {
        match self.quality {
            Quality::Substeps(count) if !(1..=MAX_SUBSTEPS).contains(&count) => {
                return Err(BuildError::value("quality: Substeps", count, "must be 1 to 65536"));
            }
            Quality::Strain(stretch) | Quality::Hold { stretch, .. } if !(stretch > 0.0 && stretch.is_finite()) => {
                return Err(BuildError::value("quality: stretch", stretch, "must be finite and above 0; 0.03 is three percent"));
            }
            Quality::Hold { share, .. } if !(0.5..=1.0).contains(&share) => {
                return Err(BuildError::value("quality: Hold share", share, "must be 0.5 to 1; 0.99 is what Strain holds"));
            }
            Quality::Budget(time) if !(time > 0.0 && time.is_finite()) => {
                return Err(BuildError::value("quality: Budget", time, "must be finite and above 0 ms"));
            }
            _ => {}
        }
        if let Some(sleep) = self.sleep {
            let speeds = [("sleep: mean_speed", sleep.mean_speed, SLOW), ("sleep: speed", sleep.speed, f32::MAX)];
            for (name, value, most) in speeds {
                if !(value > 0.0 && value <= most) {
                    return Err(BuildError::value(name, value, "must be above 0 m/s, a mean speed at most 0.01"));
                }
            }
            if !(sleep.after >= 0.0 && sleep.after.is_finite()) {
                return Err(BuildError::value("sleep: after", sleep.after, "must be finite and 0 s or above"));
            }
        }
        if let Some(Contact { thickness, friction }) = self.contact {
            if !(thickness > 0.0 && thickness <= MAX_POSITION) {
                return Err(BuildError::value("contact.thickness", thickness, "must be above 0 m and within 1e15 m"));
            }
            if !(friction >= 0.0 && friction.is_finite()) {
                return Err(BuildError::value("contact.friction", friction, "must be finite and 0 or above"));
            }
        }
        match self.method {
            Method::Relaxation { iterations } if !(1..=MAX_SUBSTEPS).contains(&iterations) => {
                Err(BuildError::value("method: Relaxation iterations", iterations, "must be 1 to 65536"))
            }
            Method::Springs if self.fabric.stretch.is_infinite() => {
                let remedy = "explicit springs cannot be inextensible; use SmallSteps";
                Err(BuildError::value("fabric.stretch", self.fabric.stretch, remedy))
            }
            _ => Ok(()),
        }
    }
}
