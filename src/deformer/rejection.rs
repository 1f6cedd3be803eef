//! Rejected steps: a step that stretched the cloth beyond the bound, which nothing had told in advance, is undone and taken again with
//! the substeps that it turned out to need, as in error-controlled integration (Hairer, Nørsett and Wanner 1993, II.4).
//!
//! A sheet whose hem swings up and hits its own upper part is stretched by 30 % in one step of 18 substeps. With more in the next step
//! it would contract at once and gain a sixth of its energy; with 81 in the same step it is stretched by 1.6 % and gains nothing
//! (`cloth_that_hits_itself_gains_no_energy`).

use super::Deformer;
use super::decision::StepDecision;
use crate::attributes::Attributes;
use crate::cpu::Cpu;
use crate::error::StepError;
use crate::error::failure::Failure;
use crate::kernels::statistics::Statistics;
use crate::options::{Backend, StepReport, Stretch, Warning};
use crate::step::plan::Plan;

/// A step that misses the bound is rejected if at least this many times as many substeps would have been chosen.
const MORE: f64 = 1.25;
/// The same step is rejected at most so often.
const REJECTIONS: usize = 3;

impl Deformer {
    /// Finishes a step that was taken, or if it is rejected, the one that is taken in its place.
    pub(super) fn accept(
        &mut self,
        mut stepped: Result<Option<Statistics>, Failure>,
        mut decision: StepDecision,
        attributes: &Attributes,
        alone: bool,
    ) -> Result<StepReport, StepError> {
        let mut rejected_for = None;
        for _ in 0..REJECTIONS {
            let Some((again, missed)) = self.rejects(&stepped, &decision, attributes) else { break };
            (decision, rejected_for) = (again, Some(missed));
            self.engine.cpu_mut().into_iter().for_each(Cpu::roll_back);
            self.set_coefficients(&decision);
            let (engine, plan) = self.plan(&decision, attributes);
            stepped = engine.step(&Plan { alone, ..plan });
        }
        let mut report = self.finish(stepped, &decision, attributes)?;
        // What only now turns out to be the fabric's own is said once.
        if let (Some(Warning::StrainMissed { promised, cause, .. }), Some(Stretch { share, .. })) = (rejected_for, report.stretch)
            && share > promised
            && !report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }))
        {
            report.warnings.push(Warning::StrainMissed { stretch: share, promised, cause });
        }
        Ok(report)
    }

    /// The decision for another step in the place of one that is rejected, and what that one would have warned of. A GPU cannot go back by the time its statistics arrive.
    fn rejects(
        &mut self,
        stepped: &Result<Option<Statistics>, Failure>,
        decision: &StepDecision,
        attributes: &Attributes,
    ) -> Option<(StepDecision, Warning)> {
        let (Some(strain_bound), Ok(Some(seen))) = (self.strain_bound(), stepped) else { return None };
        let is_within = seen.stretch_of(f64::from(strain_bound.share)) <= strain_bound.stretch;
        if is_within || self.backend() == Backend::Gpu || !decision.is_observed {
            return None;
        }
        let holds = self.holds(strain_bound, &self.contact_warnings(attributes));
        let before = std::mem::replace(&mut self.state.controller, decision.controller);
        let missed = self.learn(&decision.expected, strain_bound, seen, holds);
        self.state.controller = before.with_factor_of(&self.state.controller);
        let again = self.decide(decision.expected.dt, attributes).ok();
        self.state.controller = before;
        let again = again.filter(|again| f64::from(again.substeps) >= MORE * f64::from(decision.substeps))?;
        Some((StepDecision { looks: decision.looks, ..again }, missed?))
    }
}
