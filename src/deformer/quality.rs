//! How a bound on strain is kept: choosing the substeps of the next step, and learning from the last one.

use glam::Vec3;

use super::Deformer;
use super::contact::mesh_colliders;
use super::decision::{Expectation, StepDecision};
use crate::attributes::Attributes;
use crate::error::BuildError;
use crate::kernels::statistics::Statistics;
use crate::options::{Backend, Cause, Levels, Method, Options, Quality, Stretch, Warning};
use crate::step::controller::{Caution, Controller, FEWEST_SUBSTEPS, StrainBound, most};
use crate::step::levels::{is_gale, rolls_up};
use crate::step::load::Load;
use crate::step::own_stretch::{Measured, accepted, excess, resolved_share};
use crate::step::substep_count::SIXTIETHS;

/// The number of vertices from which levels pay off on a GPU if the substeps are chosen to keep a bound on strain.
///
/// On an H200 a substep takes 6 us without levels and 17 us with the finest, at any size below 16,384 vertices, because a
/// level's colors are swept one after another; with bending 8 to 9 us, and 20. Without levels, cloths of 4,000 vertices take
/// 1.3 to 2.5 times as many substeps for the same bound, one of 14,161 takes 3.9 times (`benches/results/quality.md`),
/// and a hung sheet of 65,536 takes 9 times (`gpu_h200.md`). With contact of triangles a substep takes 60 us and more,
/// so levels always pay: a folded sheet of 1,600 takes 1.2 ms with them and 2.0 without (`contact.md`).
const LEVELS_PAY: usize = 8192;

/// The largest coarsest level, in aggregates, that keeps a bound on strain with as many substeps as all coarser levels
/// would. Sheets and garments of 14,161 to 65,536 vertices took .91 to 1.14 times as many with the finest level alone,
/// whose aggregates have 16 vertices, as with the three to six levels that resolve the strain
/// (`benches/results/quality.md`). Each further level took 8.5 us of a substep on an H200, whatever its size, when it was swept once.
const COARSE_ENOUGH: usize = 4096;

/// The stretch that cloth with contact may have under its weight, by the strain law with a factor of 1, to keep a
/// [`Quality::Budget`].
const TAUT: f64 = 0.05;

/// Cloth is squeezed if the squeezed pairs are more than this many times the vertices that the bound leaves out. Two layers of a cape, 6 to
/// 30 mm apart, have up to 7 such pairs per 100 vertices where pins shake them with too few substeps, although there is room; a sheet or a
/// tube on which limbs close has 15 to 21.
const MANY_PAIRS: f32 = 10.0;

impl Deformer {
    /// Changes the quality from the next step on. What was learned from the motion so far is kept. Bending that was softened
    /// ([`Warning::BendingLimited`]) is as stiff as the new quality allows, which adds energy to cloth that is bent. From one number of
    /// [`Quality::Substeps`] to another it stays as soft as the fewest made it, so that the schedule of another quality can be
    /// repeated. Stretch that few substeps leave is undone by more, at once: a sheet that rests on a ball with 8 substeps jumps by
    /// 15 cm with 80.
    ///
    /// # Errors
    /// If a number in it is out of its range, or it is [`Quality::Budget`] on a GPU; the quality is then unchanged.
    pub fn set_quality(&mut self, quality: Quality) -> Result<(), BuildError> {
        let options = Options { quality, ..self.options.clone() };
        options.check_numbers()?;
        self.engine.check(quality)?;
        if quality != self.options.quality {
            if !matches!((quality, self.options.quality), (Quality::Substeps(_), Quality::Substeps(_))) {
                self.state.controller = self.state.controller.afresh();
            }
            self.options = options;
            self.wake();
        }
        Ok(())
    }

    /// The bound on strain, if the quality has one and the method can keep it.
    pub(super) fn strain_bound(&self) -> Option<StrainBound> {
        StrainBound::of(self.options.quality).filter(|_| self.options.method == Method::SmallSteps)
    }

    /// Whether a step under these attributes needs statistics. Those of contact with meshes tell whether they come near the cloth,
    /// and those of cloth that is free to fly whether it outruns contact. On a CPU they cost little, and also tell whether it is crushed.
    pub(super) fn is_observed(&self, attributes: &Attributes) -> bool {
        let flies_at_them = self.options.contact.is_some() && !self.cloth.has_pins() && !attributes.colliders.is_empty();
        self.strain_bound().is_some()
            || self.options.sleep.is_some()
            || flies_at_them
            || mesh_colliders(attributes).next().is_some()
            || self.may_be_crushed(attributes) && self.backend() != Backend::Gpu
    }

    /// The controller that chooses the substeps of a step of `dt` (s).
    pub(super) fn controlled(&self, dt: f32, load: &Load, caution: Caution, has_contact: bool) -> Controller {
        match (self.strain_bound(), self.options.quality) {
            (Some(strain_bound), _) => self.state.controller.next(&self.rates, &self.cloth, (strain_bound, caution), load, dt),
            (None, Quality::Budget(time)) => {
                // The controller counts substeps per 1/60 s.
                let steps = f64::from(dt) * SIXTIETHS;
                let fitting = self.state.pace.fitting(1e-3 * f64::from(time), self.state.controller.count * steps);
                let most = most(&self.rates, &self.cloth);
                // With fewer, cloth is stretched so far that contact takes longer, not less.
                let weight = load.weight(&self.cloth);
                let taut = (self.rates.keeping(weight, TAUT) / SIXTIETHS).clamp(FEWEST_SUBSTEPS, most);
                let least = if has_contact { taut } else { 1.0 };
                let mut controller = self.state.controller;
                controller.count = fitting.map_or(least.max(FEWEST_SUBSTEPS), |substeps| (substeps / steps).clamp(least, most));
                controller
            }
            _ => self.state.controller,
        }
    }

    /// How cautiously substeps are chosen: on a GPU without contact of triangles, or else; with levels, or with more substeps instead; for
    /// what is taut between pins.
    pub(super) fn caution(&self, has_contact: bool, trades_levels: bool, load: &Load) -> Caution {
        let caution = match self.backend() == Backend::Gpu && !has_contact {
            _ if self.cloth.is_shell => Caution::SHELL,
            false if trades_levels => Caution::PROMPT_WITHOUT_LEVELS,
            false => Caution::PROMPT,
            true if trades_levels => Caution::LATE_WITHOUT_LEVELS,
            true => Caution::LATE,
        };
        if self.state.controller.is_taut(&self.cloth, load) { caution.when_taut(load.falling_time(&self.cloth)) } else { caution }
    }

    /// Whether a step in wind of this dynamic pressure (Pa) keeps the bound on strain with more substeps instead of levels, because they
    /// take less time on a GPU without contact of triangles, or because the cloth is too soft for levels, or levels are off.
    pub(super) fn trades_levels(&self, has_contact: bool, pressure: f64) -> bool {
        let is_fast = self.backend() == Backend::Gpu && !has_contact && self.cloth.used < LEVELS_PAY;
        let may = match self.options.levels {
            Levels::Auto => is_fast || rolls_up(&self.cloth),
            Levels::Off => true,
            Levels::Count(_) => false,
        };
        may && self.strain_bound().is_some() && !is_gale(&self.cloth, pressure, self.state.controller.levels())
    }

    /// The most levels that pay off on a GPU if the substeps are chosen to keep a bound on strain.
    pub(super) fn most_levels(&self) -> usize {
        let keeps = self.options.levels == Levels::Auto && self.backend() == Backend::Gpu && self.strain_bound().is_some();
        let aggregates = (0..).map(|level| self.cloth.used >> (4 + 2 * level));
        if keeps { 1 + aggregates.take_while(|&count| count > COARSE_ENOUGH).count() } else { usize::MAX }
    }

    /// Discards what was learned from the motion, and wakes the cloth.
    pub(super) fn forget(&mut self) {
        (self.state.controller, self.state.seen) = (Controller::default(), None);
        self.state.awaiting_statistics.clear();
        self.has_arrived = false;
        self.wake();
    }

    /// Evaluates the oldest step whose statistics had not arrived, and learns from it.
    pub(super) fn evaluate(
        &mut self,
        decision: &StepDecision,
        seen: Option<&Statistics>,
        warnings: &mut Vec<Warning>,
    ) -> Option<Stretch> {
        self.state.controller = decision.controller;
        if !decision.is_observed {
            self.state.awaiting_statistics.clear();
            self.state.seen = None;
            self.state.motion.course = Vec3::ZERO;
            return None;
        }
        let mut dropped = 0.0;
        if self.engine.contact().is_some() {
            // Such a step waits for its own statistics; those of earlier ones are dropped.
            dropped = self.late();
            self.state.awaiting_statistics.clear();
        }
        self.state.awaiting_statistics.push_back(decision.expected);
        let seen = seen?;
        let expected = self.state.awaiting_statistics.pop_front()?;
        let strain_bound = self.strain_bound();
        if let Some(strain_bound) = strain_bound {
            let holds = self.holds(strain_bound, warnings);
            warnings.extend(self.learn(&expected, strain_bound, seen, holds));
        }
        if let Some(before) = self.state.seen.replace(*seen) {
            self.state.motion.observe([&before, seen], dropped + expected.dt);
        }
        let share = seen.stretch_of(f64::from(strain_bound.map_or(Quality::MOST_OF_THE_AREA, |strain_bound| strain_bound.share)));
        Some(Stretch { mean: seen.mean_stretch(), share, worst: f32::from_bits(seen.worst_stretch) })
    }

    /// What holds the cloth in a way that stretches it about as much with more substeps.
    pub(super) fn holds(&self, strain_bound: StrainBound, warnings: &[Warning]) -> Option<Cause> {
        let is_crossed = |warning: &Warning| matches!(warning, Warning::Crossings { .. } | Warning::BodyCrossings { .. });
        let squeezed = self.engine.contact().map_or(0, |tally| tally.squeezed);
        // Fewer do not matter for the share of the area whose stretch is bounded.
        let are_many = squeezed as f32 > MANY_PAIRS * (1.0 - strain_bound.share) * self.cloth.used as f32;
        let causes = [(warnings.iter().any(is_crossed), Cause::Crossings), (are_many, Cause::Squeezed)];
        causes.into_iter().find_map(|(is, cause)| is.then_some(cause))
    }

    /// Updates the controller from a step's statistics; returns a warning if the bound was exceeded.
    pub(super) fn learn(
        &mut self,
        expected: &Expectation,
        strain_bound: StrainBound,
        seen: &Statistics,
        holds: Option<Cause>,
    ) -> Option<Warning> {
        let Expectation { dt, load, length, has_contact, trades_levels } = expected;
        let (share, longest) = (strain_bound.share, f64::from(length.longest_h));
        // How many times as many substeps would still help.
        let times = SIXTIETHS * most(&self.rates, &self.cloth) * longest;
        let resolved = length.resolved;
        let held = resolved_share(&self.cloth, share, resolved, times.max(1.0).powi(-2));
        let stretch = f64::from(seen.stretch_of(f64::from(share)));
        let measured = Measured { stretch, share, resolved, held };
        let with_most = times < 1.001;
        let caution = self.caution(*has_contact, *trades_levels, load);
        let known =
            self.state.controller.own_of(stretch, with_most, caution.aim(strain_bound), *dt, load.is_calm_in_wind(&self.cloth));
        let beyond = |known| excess(&self.cloth, load, measured, known);
        let law = self.rates.strain(load.stress(&self.cloth), longest);
        self.state.controller.learn(law, beyond(known), caution, *dt, holds.is_some());
        // More substeps do not help, but that is no reason to keep silent: neither while the cloth is jerked, nor where what holds
        // it stretches it by more than a garment can be too narrow.
        let excess = beyond(accepted(&self.cloth, load, known, share));
        let missed = excess > f64::from(strain_bound.stretch);
        let slivers = self.cloth.slivers.edges as f32 > (1.0 - share) * self.cloth.links.len() as f32;
        let cause = slivers.then_some(Cause::Slivers).or(holds).unwrap_or_else(|| load.cause(&self.cloth));
        missed.then_some(Warning::StrainMissed { stretch: excess as f32, promised: strain_bound.stretch, cause })
    }
}
