//! Prediction of a step before it is taken, and its warnings.

use super::Deformer;
use super::decision::{Expectation, StepDecision};
use crate::attributes::Attributes;
use crate::error::StepError;
use crate::model::links::Slivers;
use crate::options::{Method, Options, Warning};
use crate::step::coefficients::Coefficients;
use crate::step::substep_count::{Rates, SIXTIETHS};

/// Prediction of a step from closed forms: see [`Deformer::forecast`](crate::Deformer::forecast).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Forecast {
    /// Number of substeps that the step will take, unless it is undone and taken again with more
    /// ([`Quality::Hold`](crate::Quality::Hold)); 0 if the cloth sleeps through it.
    pub substeps: u32,
    /// Coarse levels in each substep. The mesh may have fewer.
    pub levels: u32,
    /// Number of substeps that resolves the fabric's stiffness in this step, `S* = dt sqrt(k_e (w_i + w_j) / 2)` for
    /// the 95th percentile of the edges, with a quarter instead of the half for closed shells; infinite if the fabric is
    /// inextensible. With at least this many the cloth is
    /// as stiff as its fabric.
    pub resolving: f32,
    /// Number of substeps that keeps explicit springs stable in this step however the cloth moves, computed by power
    /// iteration on stretch and bending. `None` for other methods, which have no such limit.
    pub explicit: Option<f32>,
    /// Predicted stretch, beyond the fabric's own, that 99 percent of the area will not exceed in this step:
    /// `f (2 sigma/K) (S*/S)²`, where sigma is the membrane stress of what acts on the cloth in this step, and f was
    /// measured in previous steps if the quality bounds the strain. Before that it is 0.3, for closed shells 2, and on a GPU that takes
    /// more substeps instead of levels 1.2; and it is at least 1 for cloth that is about to fly into something. A sheet that was just released has
    /// no speed yet; when it swings through its lowest point it carries three times its static stress. 0 for springs,
    /// which stretch only as their stiffness says; NaN for relaxation, for which there is no law.
    pub strain: f32,
    /// The retardation time (s) with which the step damps bending, the median of the vertices that bend; at most
    /// [`Fabric::damping`](crate::Fabric::damping), of which few substeps on a fine mesh apply only a part. 0 without bending.
    pub damping: f32,
    /// The warnings that the step will return, except those of what shows only in its result: [`Warning::StrainMissed`],
    /// [`Warning::Crossings`] and [`Warning::BodyCrossings`]. [`Warning::ColliderOutruns`] depends on whether the cloth lies in layers:
    /// here as of the last step, in the report as of the step itself.
    pub warnings: Vec<Warning>,
}

impl Deformer {
    /// Predicts a step without taking it: its substeps, what they resolve, the expected strain and the warnings.
    ///
    /// This takes less time than building the cloth and does not change the state.
    ///
    /// # Errors
    /// As the checks of [`Deformer::step`], also for a step that the cloth would sleep through; a step of 0 s has no forecast and is an
    /// error too.
    pub fn forecast(&self, dt: f32, attributes: &Attributes) -> Result<Forecast, StepError> {
        let decision = self.decide(dt, attributes)?;
        let sleeps = self.sleeps(attributes);
        let StepDecision { expected: Expectation { load, length, .. }, controller, substeps, levels, .. } = decision;
        let bending = Coefficients::new(&self.cloth, &[], &self.options, length).bending;
        let strain = match self.options.method {
            Method::SmallSteps => controller.expected(&self.rates, &self.cloth, &load, length.longest_h),
            Method::Springs => 0.0,
            Method::Relaxation { .. } => f64::NAN,
        };
        let explicit = (self.options.method == Method::Springs).then_some((f64::from(dt) * self.rates.explicit) as f32);
        let resolving = f64::from(dt) * self.rates.resolving(self.cloth.membrane_stiffness);
        let warnings = if sleeps { Vec::new() } else { self.warnings(&decision, bending.limited) };
        let substeps = if sleeps { 0 } else { substeps };
        let (resolving, strain, damping) = (resolving as f32, strain as f32, bending.median_tau());
        Ok(Forecast { substeps, levels, resolving, explicit, strain, damping, warnings })
    }

    /// Substeps per 1/60 s, at least 20, that resolve the stiffness as far as a resolution is visible: see
    /// [`Rates::resolving_what_shows`].
    pub(crate) fn resolving_substeps(&self) -> u32 {
        (self.rates.resolving_what_shows(&self.cloth) / SIXTIETHS).ceil().max(20.0) as u32
    }

    /// Substeps per 1/60 s that explicit springs need with these options.
    pub(crate) fn explicit_substeps(&self, options: &Options) -> u32 {
        (Rates::new(&self.cloth, options).explicit / SIXTIETHS).ceil().min(f64::from(u32::MAX)) as u32
    }

    /// The warnings of a step that are known beforehand, with bending softened at `limited` vertices.
    pub(super) fn warnings(&self, decision: &StepDecision, limited: usize) -> Vec<Warning> {
        let &StepDecision { expected: Expectation { dt, .. }, substeps, fastest, .. } = decision;
        let limited = (limited > 0).then_some(Warning::BendingLimited { vertices: limited });
        let needed = self.rates.explicit_shortfall(dt, substeps);
        let needed = needed.map(|needed| Warning::ExplicitLimit { substeps, needed });
        let Slivers { edges, worst, .. } = self.cloth.slivers;
        let slivers = (edges > 0).then_some(Warning::Slivers { edges, worst });
        let outrun = |speed: f64, length: f32| {
            let carried = f64::from(length) * f64::from(substeps) / f64::from(dt);
            (speed > carried).then_some([speed as f32, carried as f32])
        };
        // A sweep passes a pull on by one edge length.
        let sweeps = if let Method::Relaxation { iterations } = self.options.method { iterations } else { 1 };
        let passed_on = sweeps as f32 * self.cloth.longest_edge;
        let pin = outrun(fastest.pin.1, passed_on).filter(|_| self.options.method != Method::Springs);
        let pin = pin.map(|[speed, carried]| Warning::PinOutruns { pin: fastest.pin.0, speed, carried });
        // Where cloth lies in layers, contact lets a vertex follow a collider only as far as it does not come too close to others.
        // Meshes carry what they hit.
        let in_layers = self.engine.contact().is_some_and(|tally| tally.near > 0);
        let thickness = self.options.contact.filter(|_| in_layers).map_or(f32::INFINITY, |contact| contact.thickness);
        let limits = [(fastest.solid, passed_on.min(thickness)), (fastest.collider, passed_on)];
        let collider = limits.into_iter().filter(|(_, length)| *length > 0.0).find_map(|((collider, speed), length)| {
            outrun(speed, length).map(|[speed, carried]| Warning::ColliderOutruns { collider, speed, carried })
        });
        [limited, needed, slivers, pin, collider, self.contact_outruns(decision)].into_iter().flatten().collect()
    }
}
