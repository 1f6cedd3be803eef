//! The search: the reference run, the terms, the number of substeps, and the kinds of solvers.

use super::clip::{Clip, Scene};
use super::distance::Distance;
use super::{Setting, Term, Terms, Tolerance, Trial, Tuned};
use crate::deformer::Deformer;
use crate::error::{BuildError, StepError};
use crate::kernels::limits::MAX_SUBSTEPS;
use crate::options::{Levels, Method, Quality};

/// Most runs of the scene.
const MAX_CLIPS: usize = 20;
/// Number of substeps of the second reference run relative to the first, and the displacement (m) of its vertices at
/// the start.
const AGAIN: f64 = 1.42;
const NUDGE: f32 = 1e-5;
/// Share of the resolved substeps at which terms are left out, and the fewest substeps that give a meaningful result.
const SHARE: f64 = 0.125;
const FEWEST: u32 = 5;
/// Iterations of the relaxation that is tried, and the approximate time of one of its substeps, and of one with
/// springs, relative to a substep of small steps without levels.
const ITERATIONS: u32 = 4;
const OF_RELAXATION: f64 = 2.2;
const OF_SPRINGS: f64 = 0.7;

/// A term's name, and where it is among others.
type NamedTerm = (&'static str, fn(&mut Terms) -> &mut bool);
/// Of terms with equal errors bending comes first, because damping acts on it.
const TERMS: [NamedTerm; 3] =
    [("bending", |terms| &mut terms.bending), ("damping", |terms| &mut terms.damping), ("air", |terms| &mut terms.air)];

/// What is known before the kinds of solvers are compared.
struct Baseline {
    resolved: Option<Trial>,
    chaotic: bool,
    terms: Vec<Term>,
    /// Small steps with the terms that were not dropped.
    plain: Setting,
}

/// How the error of a run is measured.
enum Judge {
    /// By its distance from the reference run.
    Position(Distance, Clip),
    /// By its own stretch.
    Strain,
}

impl Judge {
    fn error(&self, clip: &Clip, checked: bool) -> f64 {
        match self {
            Judge::Position(distance, resolved) => distance.between(clip, resolved, checked),
            Judge::Strain => clip.stretch(),
        }
    }
}

pub(super) struct Search<'a> {
    scene: Scene<'a>,
    /// The tolerance, less the uncertainty of the reference.
    tolerance: f64,
    judge: Judge,
    trials: Vec<Trial>,
}

impl<'a> Search<'a> {
    pub(super) fn new(scene: Scene<'a>, tolerance: f64) -> Search<'a> {
        Search { scene, tolerance, judge: Judge::Strain, trials: Vec::new() }
    }

    pub(super) fn run(mut self, tolerance: Tolerance) -> Result<Tuned, BuildError> {
        let given = Setting::of(self.scene.options);
        let plain = Setting { method: Method::SmallSteps, ..given };
        let cloth = Deformer::new(self.scene.mesh, plain.options(self.scene.options))?;
        let count = cloth.resolving_substeps();
        let found = match tolerance {
            Tolerance::Position(_) => {
                let found = self.look_at_position(plain, count)?;
                self.try_out(given)?;
                self.descend(found.plain, (SHARE * f64::from(count)).ceil() as u32, count)?;
                found
            }
            Tolerance::Strain(strain) => {
                self.descend_strain(plain, strain, count)?;
                Baseline { resolved: None, chaotic: false, terms: Vec::new(), plain }
            }
        };
        self.try_other_kinds(found.plain, &cloth)?;
        Ok(self.choose(found))
    }

    /// Makes both reference runs, decides how runs are compared, and drops the terms whose effect is too small.
    fn look_at_position(&mut self, plain: Setting, count: u32) -> Result<Baseline, BuildError> {
        let resolved = Setting { levels: Levels::Off, ..plain.with_substeps(count) };
        let clip = self.scene.play(&resolved, 0.0)?;
        let again = self.scene.play(&resolved.with_substeps((AGAIN * f64::from(count)).ceil() as u32), NUDGE)?;
        let apart = |distance: Distance| distance.between(&clip, &again, false).max(distance.between(&clip, &again, true));
        let floor = apart(Distance::Vertices);
        let chaotic = floor > 0.5 * self.tolerance;
        let distance = if chaotic { Distance::Spread } else { Distance::Vertices };
        let floor = apart(distance);
        self.tolerance = if chaotic { self.tolerance.max(1.5 * floor) } else { (self.tolerance.powi(2) - floor.powi(2)).sqrt() };
        let trial = Trial { error: floor as f32, checked: floor as f32, ..self.noted(resolved, &clip) };
        self.judge = Judge::Position(distance, clip);
        self.trials.push(trial);

        let eighth = plain.with_substeps(((SHARE * f64::from(count)).ceil() as u32).max(FEWEST));
        let base = finished(self.scene.play(&eighth, 0.0))?;
        let trial = self.note(eighth, base.as_ref());
        // What terms are worth is found out from that run; without it all are kept.
        let resolved = self.trials.first().copied();
        let Some(base) = base else { return Ok(Baseline { resolved, chaotic, terms: Vec::new(), plain }) };
        let mut terms = Vec::new();
        let mut there = self.scene.terms();
        for (name, of) in TERMS.into_iter().filter(|(_, of)| *of(&mut there)) {
            let mut without = eighth;
            *of(&mut without.terms) = false;
            let Some(clip) = finished(self.scene.play(&without, 0.0))? else { continue };
            let apart = distance.between(&base, &clip, false);
            let error = if chaotic { (apart.powi(2) - floor.powi(2)).max(0.0).sqrt() } else { apart };
            let milliseconds = (base.milliseconds - clip.milliseconds) as f32;
            terms.push((of, Term { name, error: error as f32, milliseconds, dropped: false }));
        }
        let mut left = 0.25 * self.tolerance.powi(2);
        let mut plain = plain;
        terms.sort_by(|a, b| a.1.error.total_cmp(&b.1.error));
        for (of, Term { name, error, dropped, .. }) in &mut terms {
            // Damping acts on bending and is dropped with it.
            let gone = *name == "damping" && !plain.terms.bending;
            left -= if gone { 0.0 } else { f64::from(*error).powi(2) };
            *dropped = gone || left >= 0.0;
            *of(&mut plain.terms) = !*dropped;
        }
        // Terms that are negligible one by one may not be so together with the error that the substeps leave.
        if self.keeps(&trial) && !self.try_out(Setting { terms: plain.terms, ..eighth })? {
            plain.terms = Terms::ALL;
            terms.iter_mut().for_each(|(_, term)| term.dropped = false);
        }
        Ok(Baseline { resolved, chaotic, terms: terms.into_iter().map(|(_, term)| term).collect(), plain })
    }

    /// Halves the number of substeps, beginning at `from`, until the tolerance is missed, or doubles it until it is
    /// kept, at most to `most`. Then tries a number between the two.
    fn descend(&mut self, setting: Setting, from: u32, most: u32) -> Result<(), BuildError> {
        let (mut kept, mut missed) = (from.clamp(FEWEST.min(most), most), 0);
        while kept < most && !self.try_out(setting.with_substeps(kept))? {
            (missed, kept) = (kept, kept.saturating_mul(2).min(most));
        }
        while missed == 0 && kept > 1 {
            if self.try_out(setting.with_substeps(kept / 2))? { kept /= 2 } else { missed = kept / 2 }
        }
        let between = (f64::from(kept) * f64::from(missed)).sqrt().round() as u32;
        if between > missed && between < kept {
            self.try_out(setting.with_substeps(between))?;
        }
        Ok(())
    }

    /// Tries the bound on strain itself, and fixed numbers of substeps near what it took.
    fn descend_strain(&mut self, plain: Setting, strain: f32, most: u32) -> Result<(), BuildError> {
        self.try_out(Setting { quality: Quality::Strain(strain), ..plain })?;
        let mean = self.trials.last().map_or(20.0, |trial| trial.substeps);
        let most = most.max(2 * mean as u32);
        self.descend(plain, mean.ceil().max(1.0) as u32, most)?;
        // No run has resolved the stiffness yet.
        if self.best().is_none() {
            self.try_out(plain.with_substeps(most))?;
        }
        Ok(())
    }

    /// Tries other kinds of solvers, beginning with the most substeps with which they could still be cheaper.
    fn try_other_kinds(&mut self, plain: Setting, cloth: &Deformer) -> Result<(), BuildError> {
        let Some(best) = self.best() else { return Ok(()) };
        // The time of a substep without levels, from the run with the most such substeps.
        let bare = self.trials.iter().filter(|trial| trial.levels == 0 && trial.substeps > 0.0 && trial.error.is_finite());
        let Some(bare) = bare.max_by(|a, b| a.substeps.total_cmp(&b.substeps)).copied() else { return Ok(()) };
        let sweep = f64::from(bare.milliseconds / bare.substeps);
        let fitting = |share: f64| ((0.9 * f64::from(best.milliseconds) / (share * sweep)) as u32).min(MAX_SUBSTEPS);
        let (count, few) = (fitting(1.0), best.substeps.ceil() as u32);
        if best.levels > 0 && count > few {
            self.halve(Setting { levels: Levels::Off, ..plain }, count)?;
        }
        let relaxed = Setting { method: Method::Relaxation { iterations: ITERATIONS }, levels: Levels::Off, ..plain };
        self.halve(relaxed, fitting(OF_RELAXATION))?;
        let springs = Setting { method: Method::Springs, levels: Levels::Off, ..plain };
        let needed = cloth.explicit_substeps(&springs.options(self.scene.options));
        if (1..=fitting(OF_SPRINGS)).contains(&needed) {
            self.try_out(springs.with_substeps(needed))?;
        }
        Ok(())
    }

    /// Halves the number of substeps for as long as the tolerance is kept.
    fn halve(&mut self, setting: Setting, from: u32) -> Result<(), BuildError> {
        let mut count = from;
        while count > 0 && self.try_out(setting.with_substeps(count))? {
            count /= 2;
        }
        Ok(())
    }

    /// Runs a setting, unless it was run before or the limit of runs is reached. Returns whether it keeps the
    /// tolerance.
    fn try_out(&mut self, setting: Setting) -> Result<bool, BuildError> {
        if let Some(trial) = self.trials.iter().find(|trial| trial.setting == setting) {
            return Ok(self.keeps(trial));
        }
        if self.trials.len() >= MAX_CLIPS - 1 - TERMS.len() {
            return Ok(false);
        }
        let clip = finished(self.scene.play(&setting, 0.0))?;
        let trial = self.note(setting, clip.as_ref());
        Ok(self.keeps(&trial))
    }

    /// Notes a run, if it came to its end, or that it did not.
    fn note(&mut self, setting: Setting, clip: Option<&Clip>) -> Trial {
        let failed = Trial { setting, substeps: 0.0, levels: 0, error: f32::INFINITY, checked: f32::INFINITY, milliseconds: 0.0 };
        let trial = clip.map_or(failed, |clip| self.noted(setting, clip));
        self.trials.push(trial);
        trial
    }

    fn noted(&self, setting: Setting, clip: &Clip) -> Trial {
        let error = |checked| self.judge.error(clip, checked) as f32;
        let (substeps, milliseconds) = (clip.substeps as f32, clip.milliseconds as f32);
        Trial { setting, substeps, levels: clip.levels, error: error(false), checked: error(true), milliseconds }
    }

    fn keeps(&self, trial: &Trial) -> bool {
        f64::from(trial.error) <= self.tolerance
    }

    /// The cheapest run so far that keeps the tolerance.
    fn best(&self) -> Option<Trial> {
        let kept = self.trials.iter().filter(|trial| self.keeps(trial));
        kept.min_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds)).copied()
    }

    /// The cheapest run that keeps the tolerance in the verifying frames too; if there is none, the one with the
    /// smallest error in all frames.
    fn choose(self, Baseline { resolved, chaotic, terms, .. }: Baseline) -> Tuned {
        let verified = |trial: &&Trial| self.keeps(trial) && f64::from(trial.checked) <= self.tolerance;
        let cheapest = self.trials.iter().filter(verified).min_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds));
        let in_all = |trial: &Trial| trial.error.max(trial.checked);
        let least = || self.trials.iter().min_by(|a, b| in_all(a).total_cmp(&in_all(b)));
        let best = *cheapest.or_else(least).expect("at least one was tried");
        let (options, kept) = (best.setting.options(self.scene.options), cheapest.is_some());
        Tuned { best, kept, options, allowed: self.tolerance as f32, resolved, chaotic, terms, trials: self.trials }
    }
}

/// The run, or `None` if it became unstable or crowded, or would have needed too many substeps.
fn finished(played: Result<Clip, BuildError>) -> Result<Option<Clip>, BuildError> {
    match played {
        Ok(clip) => Ok(Some(clip)),
        Err(BuildError::Step {
            error: StepError::Unstable { .. } | StepError::TooManySubsteps { .. } | StepError::Crowded { .. },
            ..
        }) => Ok(None),
        Err(error) => Err(error),
    }
}
