//! Chooses the number of substeps that fits a time budget.

use crate::record::recorded;

/// The measured speed of substeps.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pace {
    /// Moving average of the time (s) of a substep; 0 before anything was measured.
    substep: f64,
    /// Length (s) of the last step; 0 before the first.
    dt: f32,
}

recorded!(Pace { substep } but { dt });

/// Weight of the newest step in the moving average.
const NEWEST: f64 = 0.2;
/// A step that took more than this times as long as usual counts as this times.
const OUTLIER: f64 = 4.0;
/// Share of the budget that is used, because the time of steps varies.
const SPENT: f64 = 0.9;
/// If this much more would fit, the number of substeps is still kept.
const STEADY: f64 = 0.15;

impl Pace {
    /// The number of substeps that fit into `budget` (s). Returns `last`, that of the last step, if about as many fit;
    /// none if nothing was measured.
    pub(crate) fn fitting(&self, budget: f64, last: f64) -> Option<f64> {
        let fitting = (SPENT * budget / self.substep).floor();
        let steady = last <= fitting && fitting <= (1.0 + STEADY) * last;
        self.is_known().then_some(if steady { last } else { fitting })
    }

    /// Whether anything was measured.
    pub(crate) fn is_known(&self) -> bool {
        self.substep > 0.0
    }

    /// Begins a step of `dt` (s). Returns whether it tells what steps take, given whether its number of substeps was `chosen` anew
    /// here. Then, and in the first step, coefficients are computed that the next steps go on with. If the caller changes the length
    /// of steps or the fabric, that belongs to what he asks for.
    pub(crate) fn begin(&mut self, dt: f32, chosen: bool) -> bool {
        let last = std::mem::replace(&mut self.dt, dt);
        last > 0.0 && (!chosen || dt != last)
    }

    /// Records that `substeps` substeps took `seconds` (s).
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
