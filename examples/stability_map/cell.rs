//! A cell: one sheet, one method, one substep, and the label that it earns.
//!
//! A cell has two phases. In the first the sheet starts horizontal and at rest, out of its plane by 1e-5 m of seeded noise,
//! pinned along its top edge, and swings down without damping. In the second it hangs straight down, is jolted by random
//! velocities (0.1 m/s), and is damped by 1/s. Each takes 1.5 s; 0.5 s and more where the other methods would
//! take too many sweeps (`LONGEST`), since they fail soon or not at all. The labels, the first that holds:
//!
//! - `not finite`: a step failed as unstable, or a position is not a number. The cell ends.
//! - `gaining energy`: the mechanical energy, averaged over 0.25 s, lies above that of the phase's start by more than 1 % of the
//!   fall (`m g L/2` for an even sheet). The cell ends. Energy is as in `tests/common/energy.rs`: heights half a substep back,
//!   as velocities are. Springs count for `Springs`, and for `SmallSteps` at twice the substeps that resolve them and above;
//!   elsewhere the stretch that a sweep leaves is not backed by stiffness, and what is kinetic and potential in gravity is the
//!   least that there is. Bending's energy is left out everywhere: it is never negative, and the noise's own is below 1e-3 of
//!   the fall.
//! - `frozen`: after 0.5 s the sheet fell by less than a tenth of what the reference fell.
//! - `never resting`: over the last 0.25 s of the damped phase of T s the root mean square speed is above 0.1 exp(-T/2) m/s,
//!   to which linear modes fall at the least (0.047 m/s in 1.5 s), and above twice the reference's. A sheet of so few substeps that
//!   it sags from where it was hung bounces, and counts.
//! - `inaccurate`: after 0.5 s it is more than 0.02 m (root mean square over the vertices) from the reference, or its mean strain
//!   differs by more than 0.01.
//! - `stable`: none of these.
//!
//! The reference is resolved and in double precision (`truth.rs`).

use cloth_deformer::glam::{DVec3, Vec3};
use cloth_deformer::{Attributes, Backend, Deformer, Method, Options, Quality, StepError};

use crate::common::energy::energy;
use crate::common::reference::Spring;
use crate::sheet::{G, JOLT, Sheet};
use crate::theory;
use crate::truth::{AVERAGED, COMPARED, DAMPED, DAMPING, Truth, mean_height, mean_strain};

/// Gain of energy, in falls.
const GAIN: f64 = 0.01;
/// Share of the reference's fall below which a sheet is frozen.
const FROZEN: f64 = 0.1;
/// Bounds of the error of position (m) and of strain.
const ERRORS: [f64; 2] = [0.02, 0.01];
/// Most sweeps over a thousand edges in a phase that is longer than it must be, but for small steps.
const LONGEST: f64 = 6e3;

/// What befell a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Label {
    Stable,
    Inaccurate,
    NeverResting,
    Frozen,
    GainingEnergy,
    NotFinite,
}

impl Label {
    pub(crate) const ALL: [Label; 6] =
        [Label::Stable, Label::Inaccurate, Label::NeverResting, Label::Frozen, Label::GainingEnergy, Label::NotFinite];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Label::Stable => "stable",
            Label::Inaccurate => "inaccurate",
            Label::NeverResting => "never resting",
            Label::Frozen => "frozen",
            Label::GainingEnergy => "gaining energy",
            Label::NotFinite => "not finite",
        }
    }

    /// Whether the motion got out of hand.
    pub(crate) fn is_failure(self) -> bool {
        self >= Label::GainingEnergy
    }
}

/// A cell to run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    pub(crate) sheet: Sheet,
    pub(crate) method: Method,
    /// Substeps in each step, and steps in half a second.
    pub(crate) substeps: u32,
    pub(crate) steps: u32,
    /// Ratio of one step to the next, by turns; their mean is kept.
    pub(crate) step_ratio: f64,
}

/// What was measured. A figure that the cell did not live to is NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outcome {
    pub(crate) label: Label,
    /// Longest substep taken (s).
    pub(crate) h: f64,
    /// Most energy gained, in falls.
    pub(crate) gain: f64,
    /// Errors of position (m) and of strain.
    pub(crate) errors: [f64; 2],
    /// Root mean square speed (m/s) at the end of the damped phase.
    pub(crate) speed: f64,
}

impl Cell {
    /// The substep that is nearest to `wanted` substeps per 1/60 s, of all that take half a second in whole steps of at most
    /// 1/60 s, and that are the same whether the count is per step or per 1/60 s, rounded up.
    pub(crate) fn new(sheet: Sheet, method: Method, wanted: f64) -> Cell {
        let substeps = wanted.floor().max(1.0);
        // Above 30 n/(n - 1) steps the count of the second reading would be n - 1.
        let most = if substeps > 1.0 { (30.0 * substeps / (substeps - 1.0)).ceil() - 1.0 } else { 59.0 };
        let steps = (30.0 * wanted / substeps).round().clamp(30.0, most.max(30.0));
        Cell { sheet, method, substeps: substeps as u32, steps: steps as u32, step_ratio: 1.0 }
    }

    /// Substeps per 1/60 s.
    pub(crate) fn rate(&self) -> f64 {
        f64::from(self.substeps * self.steps) / 30.0
    }

    fn dt(&self, step: u32) -> f32 {
        let mean = COMPARED / f64::from(self.steps);
        let share = if step.is_multiple_of(2) { self.step_ratio } else { 1.0 };
        (mean * 2.0 * share / (1.0 + self.step_ratio)) as f32
    }

    /// Steps of a phase of `time` (s).
    fn phase(&self, time: f64) -> u32 {
        let least = f64::from(self.steps);
        let sweeps = match self.method {
            Method::SmallSteps => 0,
            Method::Relaxation { iterations } => self.substeps * iterations,
            _ => self.substeps,
        };
        let work = f64::from(sweeps) * 3e-3 * f64::from(self.sheet.n).powi(2);
        (least * time / COMPARED).min((LONGEST / work).max(least)).round() as u32
    }

    /// Runs it.
    pub(crate) fn run(&self, truth: &Truth) -> Outcome {
        let mut outcome = Outcome { label: Label::Stable, h: 0.0, gain: 0.0, errors: [f64::NAN; 2], speed: f64::NAN };
        outcome.label = self.judge(truth, &mut outcome);
        outcome
    }

    fn judge(&self, truth: &Truth, outcome: &mut Outcome) -> Label {
        let mut frozen = false;
        let falls = |step: u32, x: &[Vec3], _: &[Vec3], outcome: &mut Outcome| {
            if step == self.steps {
                let x: Vec<DVec3> = x.iter().map(|x| x.as_dvec3()).collect();
                let square: f64 = x.iter().zip(&truth.positions).map(|(a, b)| a.distance_squared(*b)).sum();
                let strain = mean_strain(&self.sheet.springs(), &x) - truth.strain;
                outcome.errors = [(square / x.len() as f64).sqrt(), strain.abs()];
                frozen = -mean_height(&x) < FROZEN * truth.fallen;
            }
        };
        if let Err(label) = self.play(self.phase(DAMPED), self.sheet.level(), 0.0, outcome, falls) {
            return label;
        }
        let steps = self.phase(DAMPED);
        let last = (f64::from(self.steps) * AVERAGED / COMPARED).round() as u32;
        let mut square = 0.0;
        let rests = |step: u32, _: &[Vec3], v: &[Vec3], _: &mut Outcome| {
            if step + last > steps {
                square += v.iter().map(|v| f64::from(v.length_squared())).sum::<f64>() / v.len() as f64;
            }
        };
        if let Err(label) = self.play(steps, self.sheet.jolted(), DAMPING, outcome, rests) {
            return label;
        }
        outcome.speed = (square / f64::from(last)).sqrt();
        // A shorter phase leaves more.
        let left = |time: f64| (-0.5 * DAMPING * time).exp();
        let resting = JOLT.max(2.0 * truth.speed / left(DAMPED)) * left(f64::from(steps) * COMPARED / f64::from(self.steps));
        if frozen {
            Label::Frozen
        } else if outcome.speed > resting {
            Label::NeverResting
        } else if outcome.errors.iter().zip(ERRORS).any(|(error, bound)| *error > bound) {
            Label::Inaccurate
        } else {
            Label::Stable
        }
    }

    /// Steps from a state, watching the energy; `see` is shown the positions and velocities after each step.
    fn play(
        &self,
        steps: u32,
        (x, v): (Vec<Vec3>, Vec<Vec3>),
        damping: f64,
        outcome: &mut Outcome,
        mut see: impl FnMut(u32, &[Vec3], &[Vec3], &mut Outcome),
    ) -> Result<(), Label> {
        let sheet = &self.sheet;
        let masses = sheet.masses();
        let mut deformer = self.deformer();
        deformer.set_state(&x, &v).expect("a finite state");
        let attributes = Attributes { damping: damping as f32, ..Attributes::default() };
        let (fall, window) = (sheet.fall(), (f64::from(self.steps) * AVERAGED / COMPARED).round());
        let mut springs: Vec<Spring> = Vec::new();
        let (mut start, mut sum) = (0.0, 0.0);
        for step in 1..=steps {
            let dt = self.dt(step - 1);
            let report = match deformer.step(dt, &attributes) {
                Ok(report) => report,
                Err(StepError::Unstable { .. }) => return Err(Label::NotFinite),
                Err(error) => panic!("{self:?}: {error}"),
            };
            let h = f64::from(dt) / f64::from(report.substeps);
            if step == 1 || h > outcome.h {
                outcome.h = outcome.h.max(h);
                springs = self.springs(outcome.h);
                start = energy(&springs, &masses, G, 0.0, &x, &v);
            }
            let v = deformer.velocities().map_err(|_| Label::NotFinite)?.to_vec();
            let x = deformer.positions().map_err(|_| Label::NotFinite)?;
            let gain = (energy(&springs, &masses, G, h, x, &v) - start) / fall;
            if !gain.is_finite() {
                return Err(Label::NotFinite);
            }
            sum += gain;
            if f64::from(step) % window == 0.0 {
                outcome.gain = outcome.gain.max(sum / window);
                sum = 0.0;
            }
            if outcome.gain > GAIN {
                return Err(Label::GainingEnergy);
            }
            see(step, x, &v, outcome);
        }
        Ok(())
    }

    /// The springs whose energy counts, at the longest substep `h` (s).
    fn springs(&self, h: f64) -> Vec<Spring> {
        let counts = match self.method {
            Method::Springs => true,
            Method::SmallSteps => theory::resolved(&self.sheet) * 60.0 * h <= 0.5,
            _ => false,
        };
        if counts { self.sheet.springs() } else { Vec::new() }
    }

    fn deformer(&self) -> Deformer {
        let options = Options {
            backend: Backend::Cpu,
            method: self.method,
            quality: Quality::Substeps(self.substeps),
            fabric: self.sheet.fabric(),
            pinned: self.sheet.pinned(),
            mass: Some(self.sheet.masses()),
            ..Options::default()
        };
        let mut deformer = Deformer::new(&self.sheet.mesh(), options).expect("a sheet in range");
        // The others are for the other cells.
        deformer.on_threads(1);
        deformer
    }
}
