//! The translation of failures into errors, in the caller's terms.

use super::Deformer;
#[cfg(feature = "gpu")]
use crate::device::fault::{GpuFault, Need};
use crate::error::failure::{Defect, Failure};
use crate::error::{Instability, StepError};
use crate::options::Method;
use crate::step::substep_count::SIXTIETHS;
use crate::step::watch::Bounds;

impl Deformer {
    /// Translates a failure into the caller's terms: the mesh's vertex indices, units and a remedy.
    pub(super) fn failed(&self, failure: Failure) -> StepError {
        match failure {
            Failure::Unstable { cause, step } => {
                let named = |vertex: usize| self.cloth.order[vertex] as usize;
                let Bounds { speed, edge_length: length } = self.state.bounds;
                let (vertex, cause) = match cause {
                    Defect::Lost(vertex) => (named(vertex), Instability::NotFinite { vertex: named(vertex) }),
                    Defect::Energy(vertex) => (named(vertex), Instability::Energy { vertex: named(vertex), speed }),
                    Defect::Edge(place) => {
                        let ends = self.cloth.links[place].ends.map(|end| self.cloth.order[end as usize]);
                        (ends[0] as usize, Instability::Edge { ends, length })
                    }
                };
                StepError::Unstable { vertex, cause, step, remedy: self.remedy(cause) }
            }
            Failure::Crowded(pairs) => StepError::Crowded { pairs },
            #[cfg(feature = "gpu")]
            Failure::Gpu(fault) => match fault {
                GpuFault::Lost => StepError::GpuLost { gpu: self.adapter().unwrap_or_default().to_owned() },
                GpuFault::Memory(reason) => StepError::GpuMemory { reason },
                GpuFault::Limit(Need { thing, needed, limit, allowed }) => StepError::GpuLimit { thing, needed, limit, allowed },
                GpuFault::Other(reason) => StepError::Gpu { reason },
            },
        }
    }

    /// The remedy for an instability.
    fn remedy(&self, cause: Instability) -> String {
        // Substeps per 1/60 s, the unit of `Quality::Substeps`.
        let h = self.coefficients.as_ref().map_or(0.0, |used| f64::from(used.length.h));
        let (substeps, needed) = ((1.0 / (SIXTIETHS * h)).round(), (self.rates.explicit / SIXTIETHS).ceil());
        match (self.options.method, cause) {
            (Method::Springs, _) if substeps < needed => format!(
                "{substeps} substeps per 1/60 s are too few for explicit springs, which need {needed} here; use that many, a softer fabric or SmallSteps"
            ),
            (_, Instability::Edge { .. }) => {
                "move pins and colliders no farther apart than the cloth reaches, or move the cloth with set_state".to_owned()
            }
            (Method::Springs, _) => {
                "explicit springs may become unstable in a violent motion; use more substeps, smaller attributes or SmallSteps"
                    .to_owned()
            }
            _ => "use a shorter dt, more substeps or smaller attributes".to_owned(),
        }
    }
}
