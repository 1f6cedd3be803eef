//! As many substeps as a time allows.

use crate::record::recorded;

/// How long substeps have taken.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pace {
    /// Time (s) that a substep takes; 0 if nothing is known.
    substep: f64,
}

recorded!(Pace { substep });

/// Weight of the newest step, and how many times longer than usual a step may take and still be believed.
const NEWEST: f64 = 0.2;
const OUTLIER: f64 = 4.0;
/// Share of the budget that is spent, for steps differ.
const SPENT: f64 = 0.9;
/// Growth of the time that does not change the substeps yet.
const STEADY: f64 = 0.15;

impl Pace {
    /// Substeps of a step that is to take `budget` (s), those of the last step being `last`; as many again where about as many fit.
    pub(crate) fn fitting(&self, budget: f64, last: f64) -> Option<f64> {
        let fitting = (SPENT * budget / self.substep).floor();
        let steady = last <= fitting && fitting <= (1.0 + STEADY) * last;
        (self.substep > 0.0).then_some(if steady { last } else { fitting })
    }

    /// Notes that so many substeps took so long (s).
    pub(crate) fn note(&mut self, seconds: f64, substeps: u32) {
        let now = seconds / f64::from(substeps);
        self.substep = match self.substep {
            0.0 => now,
            before => before + NEWEST * (now.min(OUTLIER * before) - before),
        };
    }
}

#[cfg(test)]
#[path = "../../tests/unit/step_pace.rs"]
mod tests;
