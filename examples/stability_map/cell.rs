//! A cell of a map: one sheet, one method and one substep, and the label that the run gets.
//!
//! A cell has two phases. In the first the sheet starts horizontal and at rest, displaced out of its plane by 1e-5 m of
//! seeded noise, pinned along its top edge, and swings down without damping. In the second it hangs straight down, is
//! jolted by random velocities (0.1 m/s), and is damped by 1/s. Each phase takes 1.5 s. For methods other than small
//! steps it may be shortened, to no less than 0.5 s, where it would take too many sweeps (`LONGEST`), because these
//! methods fail soon or not at all. The label is the first of these that applies:
//!
//! - `not finite`: a step failed because a position is not a number or beyond 1e15 m. The cell ends.
//! - `gaining energy`: a step failed because the cloth moves faster, or an edge is longer, than everything in the scene
//!   can explain (`Instability::Energy`, `Instability::Edge`), or the mechanical energy, averaged over 0.25 s, exceeds
//!   that at the start of the phase by more than 1 % of the fall (`m g L/2` for an even sheet). The cell ends. The
//!   energy is that of `tests/common/energy.rs`:
//!   heights are those of half a substep ago, as velocities are. Springs count for `Springs`, and for `SmallSteps` from
//!   twice the substeps that resolve them on. With fewer substeps the stretch that a sweep leaves does not correspond
//!   to a stored energy, so kinetic plus gravitational energy is a lower bound. The energy of bending is left out
//!   everywhere: it is never negative, and that of the noise is below 1e-3 of the fall.
//! - `frozen`: after 0.5 s the sheet fell by less than a tenth of what the reference fell.
//! - `never resting`: over the last 0.25 s of the damped phase of T s the root mean square speed is above 0.1 exp(-T/2)
//!   m/s, the speed of the slowest decaying linear mode (0.047 m/s in 1.5 s), and above twice the reference's. A sheet
//!   with so few substeps that it sags from where it was hung bounces, and gets this label.
//! - `inaccurate`: after 0.5 s the root mean square distance of the vertices from the reference is more than 0.02 m, or
//!   the mean strain differs by more than 0.01.
//! - `stable`: none of these.
//!
//! The reference is resolved and in double precision (`truth.rs`).

use cloth_deformer::glam::{DVec3, Vec3};
use cloth_deformer::{Attributes, Backend, Deformer, Instability, Method, Options, Quality, StepError};

use crate::common::energy::energy;
use crate::common::reference::Spring;
use crate::sheet::{G, JOLT, Sheet};
use crate::theory;
use crate::truth::{AVERAGED, COMPARED, DAMPED, DAMPING, Truth, mean_height, mean_strain};

/// Allowed gain of energy, in units of the energy of the fall.
const GAIN: f64 = 0.01;
/// A sheet that falls by less than this share of the reference's fall is frozen.
const FROZEN: f64 = 0.1;
/// Allowed errors of position (m) and of strain.
const ERRORS: [f64; 2] = [0.02, 0.01];
/// Most sweeps over a thousand edges in a phase that may be shortened.
const LONGEST: f64 = 6e3;

/// The result of a cell.
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

    /// Whether the motion was unstable.
    pub(crate) fn is_failure(self) -> bool {
        self >= Label::GainingEnergy
    }
}

/// The label of a run that the watch over every step has ended.
fn failure(error: StepError) -> Label {
    match error {
        StepError::Unstable { cause: Instability::Energy { .. } | Instability::Edge { .. }, .. } => Label::GainingEnergy,
        StepError::Unstable { .. } => Label::NotFinite,
        error => panic!("{error}"),
    }
}

/// The parameters of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    pub(crate) sheet: Sheet,
    pub(crate) method: Method,
    /// Substeps per step, and steps in half a second.
    pub(crate) substeps: u32,
    pub(crate) steps: u32,
    /// Ratio of alternating step lengths, with a fixed mean.
    pub(crate) step_ratio: f64,
    pub(crate) backend: Backend,
}

/// The measurements of a cell. Those that the run did not reach are NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Outcome {
    pub(crate) label: Label,
    /// Longest substep taken (s).
    pub(crate) h: f64,
    /// Largest gain of energy, in units of the energy of the fall.
    pub(crate) gain: f64,
    /// Errors of position (m) and of strain.
    pub(crate) errors: [f64; 2],
    /// Root mean square speed (m/s) at the end of the damped phase.
    pub(crate) speed: f64,
}

impl Cell {
    /// The substep nearest to `wanted` substeps per 1/60 s, among those that divide half a second into whole steps of
    /// at most 1/60 s, and for which it makes no difference whether substeps are counted per step or per 1/60 s,
    /// rounded up.
    pub(crate) fn new(sheet: Sheet, method: Method, wanted: f64) -> Cell {
        let substeps = wanted.floor().max(1.0);
        // Above 30 n/(n - 1) steps, counting per 1/60 s would give n - 1.
        let most = if substeps > 1.0 { (30.0 * substeps / (substeps - 1.0)).ceil() - 1.0 } else { 59.0 };
        let steps = (30.0 * wanted / substeps).round().clamp(30.0, most.max(30.0));
        Cell { sheet, method, substeps: substeps as u32, steps: steps as u32, step_ratio: 1.0, backend: Backend::Cpu }
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

    /// Number of steps in a phase of `time` (s).
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

    /// Runs the cell.
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
        // A shorter phase damps less.
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

    /// Steps from a state and checks the energy; `see` receives positions and velocities after each step.
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
            let report = deformer.step(dt, &attributes).map_err(failure)?;
            let h = f64::from(dt) / f64::from(report.substeps);
            if step == 1 || h > outcome.h {
                outcome.h = outcome.h.max(h);
                springs = self.springs(outcome.h);
                start = energy(&springs, &masses, G, 0.0, &x, &v);
            }
            let v = deformer.velocities().map_err(failure)?.to_vec();
            let x = deformer.positions().map_err(failure)?;
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

    /// The springs whose energy counts with substeps of at most `h` (s).
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
            backend: self.backend,
            method: self.method,
            quality: Quality::Substeps(self.substeps),
            fabric: self.sheet.fabric(),
            pinned: self.sheet.pinned(),
            mass: Some(self.sheet.masses()),
            ..Options::default()
        };
        let mut deformer = Deformer::new(&self.sheet.mesh(), options).expect("a sheet in range");
        // The other threads run other cells.
        deformer.on_threads(1);
        deformer
    }
}
