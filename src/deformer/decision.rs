//! What is decided about a step before it is taken: its substeps and levels, and what its result is checked with.

use crate::attributes::Attributes;
use crate::deformer::Deformer;
use crate::deformer::buckling::Looks;
use crate::error::StepError;
use crate::kernels::limits::{MAX_SUBSTEPS, MIN_TIME_STEP};
use crate::options::{Method, Quality};
use crate::record::recorded;
use crate::step::controller::{Controller, FEWEST_SUBSTEPS};
use crate::step::load::{Fastest, Load, LoadInputs};
use crate::step::substep_count::{Division, Length, SIXTIETHS};
use crate::step::watch::Bounds;

/// What the statistics of a step are judged by, which a GPU returns some steps later.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Expectation {
    /// Length of the step (s).
    pub(super) dt: f32,
    pub(super) load: Load,
    pub(super) length: Length,
    /// Whether triangles can touch.
    pub(super) has_contact: bool,
    /// Whether there are more substeps instead of levels. The caution depends on both.
    pub(super) trades_levels: bool,
}

recorded!(Expectation { dt, load, length, has_contact, trades_levels });

/// Everything that is decided about a step before it is taken.
pub(super) struct StepDecision {
    pub(super) expected: Expectation,
    /// The controller as it was when it chose the substeps.
    pub(super) controller: Controller,
    /// Substeps per second that the quality asks for.
    pub(super) substep_rate: f64,
    pub(super) substeps: u32,
    /// Number of coarse levels to ask for.
    pub(super) levels: u32,
    /// Whether these are fewer than carry the load, although the mesh may have no more.
    pub(super) lacks_levels: bool,
    /// What moves fastest in the step, and the bounds that its result is checked with.
    pub(super) fastest: Fastest,
    pub(super) bounds: Bounds,
    /// Whether the step computes statistics.
    pub(super) is_observed: bool,
    /// When to look for crushed cloth again.
    pub(super) looks: Looks,
}

impl Deformer {
    /// Checks the attributes of a step. Returns the contact thickness (m), if triangles can touch.
    pub(super) fn check(&self, attributes: &Attributes) -> Result<Option<f64>, StepError> {
        attributes.validate(self.cloth.pinned.len())?;
        self.state.motion.check(&attributes.colliders)?;
        let thickness = self.contact_thickness(attributes)?;
        thickness.map_or(Ok(()), |thickness| self.check_contact(attributes, thickness))?;
        Ok(thickness)
    }

    /// Checks the arguments of a step and decides how it is taken.
    pub(super) fn decide(&self, dt: f32, attributes: &Attributes) -> Result<StepDecision, StepError> {
        check_time_step(dt)?;
        let thickness = self.check(attributes)?;
        let seen = self.state.seen.as_ref();
        let inputs = LoadInputs { cloth: &self.cloth, motion: &self.state.motion, attributes, dt, seen };
        let fastest = Fastest::of(inputs, self.late());
        let load = Load::of(inputs, &fastest, thickness);
        let has_contact = thickness.is_some();
        let trades_levels = self.trades_levels(has_contact, load.lasting_pressure);
        let controller = self.controlled(dt, &load, self.caution(has_contact, trades_levels, &load), has_contact);
        let substep_rate = self.substep_rate(dt, &controller, thickness, &load);
        // The first substeps of a budget are a guess.
        let is_guess = matches!(self.options.quality, Quality::Budget(_)) && !self.state.pace.is_known();
        let mut controller = if is_guess { controller } else { controller.after(substep_rate) };
        let Division { substeps, length } =
            self.rates.divide(&self.cloth, &self.options, dt, substep_rate, controller.longest)?;
        let before = self.state.controller.levels();
        let levels = self.rates.levels(&self.cloth, &self.options, length, load.lasting_pressure, before);
        controller.levels = levels as u32;
        let levels = if trades_levels { 0 } else { levels.min(self.most_levels()) } as u32;
        let watch = self.state.watch.with_step(attributes, f64::from(dt), &fastest);
        Ok(StepDecision {
            expected: Expectation { dt, load, length, has_contact, trades_levels },
            controller,
            substep_rate,
            substeps,
            levels,
            lacks_levels: (levels as usize) < self.rates.fewest_levels(&self.cloth, length),
            fastest,
            bounds: watch.bounds(&self.cloth, &self.rates, attributes, length),
            is_observed: self.is_observed(attributes),
            looks: Looks::default(),
        })
    }

    /// Substeps per second in a step of `dt` (s): as many as the quality asks for, and as contact of this thickness (m) needs.
    pub(super) fn substep_rate(&self, dt: f32, controller: &Controller, thickness: Option<f64>, load: &Load) -> f64 {
        let asked = self.rates.substep_rate(&self.options, controller.count);
        let substep_rate =
            thickness.map_or(asked, |thickness| asked.max(self.resolving_contact(thickness, load.kinematic_speed)));
        if matches!(self.options.quality, Quality::Substeps(_)) || self.options.method != Method::SmallSteps {
            return substep_rate;
        }
        // A number that was chosen here is no reason to fail, unless the step is too long for even the least.
        // It is a whole number of substeps in 1/60 s, as the report gives it.
        substep_rate.min(SIXTIETHS * (f64::from(MAX_SUBSTEPS) / f64::from(dt) / SIXTIETHS).floor().max(FEWEST_SUBSTEPS))
    }
}

pub(super) fn check_time_step(dt: f32) -> Result<(), StepError> {
    if dt >= MIN_TIME_STEP && dt.is_finite() { Ok(()) } else { Err(StepError::TimeStep { dt }) }
}
