//! Rejected steps: a step that stretched the cloth beyond the bound, which nothing had told in advance, is undone and taken again with
//! the substeps that it turned out to need, as in error-controlled integration (Hairer, Nørsett and Wanner 1993, II.4). A step in which
//! contact stopped cloth so suddenly that what followed it got through, without having been listed, is taken again with all pairs listed
//! that may meet.
//!
//! A sheet of 65 by 81 vertices whose hem swings up and hits its own upper part is stretched by 30 % in one step of 18 substeps. With
//! more in the next step it would contract at once and gain a sixth of its energy; with 81 in the same step it is stretched by 1.6 %
//! and gains nothing (`benches/results/quality.md`; `cloth_that_hits_itself_gains_no_energy` has a coarser one).

use super::Deformer;
use super::decision::StepDecision;
use crate::attributes::Attributes;
use crate::backend::Stepped;
use crate::error::StepError;
use crate::options::{Backend, StepReport, Stretch, Warning};
use crate::step::plan::{Listing, Plan};

/// A step that misses the bound is rejected if at least this many times as many substeps would have been chosen.
const MORE: f64 = 1.25;
/// The same step is rejected at most so often.
const REJECTIONS: usize = 3;

impl Deformer {
    /// Finishes a step that was taken, or if it is rejected, the one that is taken in its place.
    pub(super) fn accept(
        &mut self,
        mut stepped: Stepped,
        mut decision: StepDecision,
        attributes: &Attributes,
        alone: bool,
    ) -> Result<StepReport, StepError> {
        let was_held = self.state.controller.is_held();
        let mut rejected_for = None;
        stepped = self.uncrossed(stepped, &decision, attributes, alone);
        for _ in 0..REJECTIONS {
            let Some((again, missed)) = self.rejects(&stepped, &decision, attributes) else { break };
            rejected_for = Some(missed);
            let before = std::mem::replace(&mut decision, again);
            stepped = self.take_again(&decision, attributes, alone);
            // Where more substeps do not succeed, those that did have to do.
            if stepped.is_err() {
                decision = before;
                stepped = self.take_again(&decision, attributes, alone);
                break;
            }
        }
        let mut report = self.finish(stepped, &decision, attributes)?;
        // That stretch is the fabric's own, and not to be bounded, is said when it turns out.
        if let (Some(Warning::StrainMissed { stretch, promised, cause }), Some(Stretch { share, .. })) =
            (rejected_for, report.stretch)
            && !was_held
            && self.state.controller.is_held()
            && share > promised
            && !report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }))
        {
            report.warnings.push(Warning::StrainMissed { stretch: stretch.min(share), promised, cause });
        }
        Ok(report)
    }

    /// A step that was taken, or if cloth got through something in it, the one that is taken in its place.
    fn uncrossed(&mut self, stepped: Stepped, decision: &StepDecision, attributes: &Attributes, alone: bool) -> Stepped {
        if stepped.is_err() || !self.engine.has_crossed() {
            return stepped;
        }
        let mut retake = |listing| {
            self.engine.roll_back();
            let (engine, plan) = self.plan(decision, attributes);
            engine.step(&Plan { listing, alone, ..plan })
        };
        // There may be too many pairs to list.
        retake(Listing::EveryStop).or_else(|_| retake(Listing::Expected))
    }

    /// Takes a step in the place of the last one.
    fn take_again(&mut self, decision: &StepDecision, attributes: &Attributes, alone: bool) -> Stepped {
        self.engine.roll_back();
        self.set_coefficients(decision);
        let (engine, plan) = self.plan(decision, attributes);
        let stepped = engine.step(&Plan { alone, ..plan });
        self.uncrossed(stepped, decision, attributes, alone)
    }

    /// The decision for another step in the place of one that is rejected, and what that one would have warned of. On a GPU without
    /// contact of triangles none is, because statistics arrive three steps late.
    fn rejects(
        &mut self,
        stepped: &Stepped,
        decision: &StepDecision,
        attributes: &Attributes,
    ) -> Option<(StepDecision, Warning)> {
        let (Some(strain_bound), Ok(Some(seen))) = (self.strain_bound(), stepped) else { return None };
        let is_within = seen.stretch_of(f64::from(strain_bound.share)) <= strain_bound.stretch;
        let is_late = self.backend() == Backend::Gpu && self.engine.contact().is_none();
        if is_within || is_late || !decision.is_observed {
            return None;
        }
        let holds = self.holds(strain_bound, &self.contact_warnings(attributes));
        let before = std::mem::replace(&mut self.state.controller, decision.controller);
        let missed = self.learn(&decision.expected, strain_bound, seen, holds);
        let tried = std::mem::replace(&mut self.state.controller, before);
        let missed = missed?;
        self.state.controller = before.rejected(&tried);
        let again = self.decide(decision.expected.dt, attributes).ok();
        self.state.controller = before;
        let again = again.filter(|again| f64::from(again.substeps) >= MORE * f64::from(decision.substeps))?;
        Some((StepDecision { looks: decision.looks, ..again }, missed))
    }
}
