//! Chooses the number of substeps that keeps a strain bound: predicted before a step from what acts on the cloth, and
//! corrected after it by the measured strain.

use crate::model::cloth::Cloth;
use crate::options::Quality;
use crate::record::recorded;
use crate::step::load::Load;
use crate::step::own_stretch::own_stretch;
use crate::step::substep_count::{Rates, SIXTIETHS};

/// Minimum number of substeps in 1/60 s.
pub(crate) const FEWEST_SUBSTEPS: f64 = 5.0;
/// The number of substeps is lowered at most to this share at a time.
const FALL: f64 = 0.8;
/// The number of substeps of cloth without pins rises at most by this factor at a time, once it is under way and unless it is about to
/// hit something. A rise by a factor multiplies the energy in stretched edges by its square, and what nothing holds is thrown up by
/// that: a sheet of .15 m that fell on a post rose by .43 m after a fall of .13 m (`what_is_caught_is_not_thrown_up`). In
/// steps with the number between, the edges contract first.
const RISE: f64 = 1.5;
/// The load is steady if its stress changes by less than this share in a step.
const STEADY: f64 = 0.02;
/// A load that lasts is no longer the one under which a number was too small if its stress is less by this factor.
const CALMER: f64 = 1.3;
/// A number of substeps to which it fell is too small for the load if it rises again within this time (s), or within so many steps, after
/// which a GPU has measured it.
const TRIED: f32 = 0.1;
const TRIED_STEPS: f32 = 3.5;
/// The least factor in the strain law of cloth that flies into something. Sheets of 1 m with 41 and 81 vertices per side that fall flat on a
/// box from 0.16 to 1.5 m are stretched by 2.5 to 4.9 % then, and by 4.7 to 18.7 % with the factor that they had learned in flight
/// (`cloth_that_falls_on_something_is_ready_for_it`).
const STOPPED: f64 = 1.0;
/// It flies into something if that adds this share of the stress of gravity.
const HIT: f64 = 0.1;
/// Cloth with pins counts as taut between them if under a calm load it is stretched more than the strain law says with this factor. A
/// sheet that hangs by an edge without levels has a factor of 1 and counts, too.
const TAUT_FACTOR: f64 = 0.5;
/// A strain this small counts as zero; also the lower bound of the factor.
const NOTHING: f64 = 1e-9;

/// How cautiously the substeps are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Caution {
    /// The factor in the strain law before anything was measured.
    first_factor: f64,
    /// The controller aims at this share of the bound on stretch.
    aim: f64,
    /// While the load is steady, the number of substeps rises only where the stretch would exceed this share of the bound.
    most: f64,
    /// Time constant (s) with which a factor that turned out too large decays.
    memory: f64,
    /// Time (s) for which fewer substeps must have sufficed before their number is lowered, unless the cloth is held stretched.
    patience: f64,
    /// Their number is lowered to one that is expected to leave this share of the stretch aimed at.
    spare: f64,
    /// Numbers of substeps per octave that are chosen from: see [`Caution::rounded_up`].
    per_octave: f64,
}

impl Caution {
    /// For steps that are measured immediately. Their controller can react at once, so it need not remember for long:
    /// compared with [`Caution::LATE`], fifteen scenes take 9 % fewer substeps, and two thirds as many of their frames
    /// exceed the bound (`benches/results/quality.md`).
    pub(crate) const PROMPT: Caution =
        Caution { first_factor: 0.3, aim: 0.6, most: 0.75, memory: 0.35, patience: 0.05, spare: 1.0, per_octave: 6.0 };
    /// The same without levels, where the strain law holds with a factor of about 1. A load that sets in at once, as gravity does in the
    /// first step, stretches cloth twice as far as in the long run.
    pub(crate) const PROMPT_WITHOUT_LEVELS: Caution = Caution { first_factor: 2.0, ..Caution::PROMPT };
    /// For steps that are measured three steps later, with coarse levels, whose strain grows less where the prediction was
    /// wrong.
    pub(crate) const LATE: Caution =
        Caution { first_factor: 0.3, aim: 0.7, most: 0.85, memory: 0.5, patience: 0.1, spare: 1.0, per_octave: 4.0 };
    /// The same without levels. In the nine scenes of `cargo bench --bench quality`, 44 to 48 of 1440 frames then exceed the
    /// bound with [`Caution::LATE`], 13 with an aim of 0.6, and 8 with this one.
    pub(crate) const LATE_WITHOUT_LEVELS: Caution = Caution { first_factor: 1.2, aim: 0.55, most: 0.75, ..Caution::LATE };

    /// For closed shells. Where the cloth cannot fold, each rise of the substeps stiffens edges under load and so adds
    /// energy. So their number starts higher, aims closer to the bound, and falls late, to rise less often: dropped on a
    /// floor, eleven balls and parts of balls then give damping air at most 1.5 times the energy that gravity gives them,
    /// and with [`Caution::PROMPT`] up to six times, for as many substeps (`benches/results/quality.md`).
    /// For the same reason their number does not stay where the stretch is above the aim.
    pub(crate) const SHELL: Caution =
        Caution { first_factor: 2.0, aim: 0.7, most: 0.7, memory: 2.0, patience: 0.5, spare: 1.0, per_octave: 6.0 };

    /// The same for cloth that is taut between its pins ([`Controller::is_taut`]) and would take this `time` (s) to fall by half its size.
    ///
    /// The energy of its swings passes through stretch and back. In substeps that do not resolve its stiffness, cloth is the stiffer the
    /// more of them there are. So if their number rose in each swing where the cloth is stretched, and fell where it is slack, that would
    /// keep it swinging for ever: a towel of 3 m that is held on four sides, at 1 m/s (`what_is_held_taut_stops_swinging`). So its memory
    /// is longer than a swing. And cloth at rest sinks when their number falls, and swings past its new place; with some stretch to spare,
    /// that does not raise the number again.
    pub(crate) fn when_taut(self, time: f64) -> Caution {
        Caution { memory: self.memory.max(3.0 * time), spare: 0.7, ..self }
    }

    /// The stretch beyond the fabric's own that the controller aims at.
    pub(crate) fn aim(self, strain_bound: StrainBound) -> f64 {
        self.aim * f64::from(strain_bound.stretch)
    }

    /// Rounds up to the next number of the form `ceil(2^(k/n))`, so that a light breeze does not change the number of
    /// substeps in every step. These are integers, so any of them can be requested again as [`Quality::Substeps`].
    fn rounded_up(self, count: f64) -> f64 {
        let power = (self.per_octave * count.log2()).floor();
        let [below, above] = [power, power + 1.0].map(|power| (power / self.per_octave).exp2().ceil());
        if below >= count { below } else { above }
    }
}

/// A bound on strain: `share` of the cloth's area is stretched at most by `stretch` beyond the fabric's own stretch under
/// its load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StrainBound {
    pub stretch: f32,
    pub share: f32,
}

impl StrainBound {
    pub(crate) fn of(quality: Quality) -> Option<StrainBound> {
        match quality {
            Quality::Strain(stretch) => Some(StrainBound { stretch, share: Quality::MOST_OF_THE_AREA }),
            Quality::Hold { stretch, share } => Some(StrainBound { stretch, share }),
            _ => None,
        }
    }
}

/// The state of the controller, from which, together with the load, the number of substeps of the next step follows.
///
/// Where substeps do not resolve the stiffness, the strain beyond the fabric's own is `f (2 sigma/K) (S*/S)²`. This law
/// holds for a sheet hung by an edge; the factor `f` stands for everything else about the scene and is measured. So
/// `S = S* sqrt(2 sigma f / (K tau))`, in which K cancels (`S*` is proportional to its square root).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Controller {
    /// The factor `f` of the strain law.
    factor: f64,
    /// Substeps in 1/60 s of the last step, or of the one that this state is for; 0 before the first.
    pub count: f64,
    /// For how long (s) fewer substeps would have sufficed.
    low: f32,
    /// The longest substep (s) that was allowed in any step since the cloth was placed, its bending changed, or its quality to or from
    /// another kind than [`Quality::Substeps`]; 0 before the first.
    pub longest: f64,
    /// The stretch that was last measured with as many substeps as help ([`most`]): it is the fabric's own, as of cloth that is
    /// too narrow for what it is pulled over. 0 if it is not known.
    own: f64,
    /// Time (s) since then in which the load was not calm.
    known_for: f32,
    /// The load's stress (N/m) in the last step.
    stress: f64,
    /// The largest number of substeps that was too small as soon as it was fallen to, while `own` is known or the load lasts; 0 if none
    /// was.
    too_few: f64,
    /// The load's stress (N/m) then.
    failed_under: f64,
    /// Time (s) since the number fell.
    fallen_for: f32,
    /// The number of levels that [`Rates::levels`] chose for the last step; [`u32::MAX`] before the first.
    pub levels: u32,
}

recorded!(Controller { factor, count, low, longest, own, known_for, stress, too_few, failed_under, fallen_for, levels });

impl Default for Controller {
    fn default() -> Controller {
        let factor = Caution::PROMPT.first_factor;
        Controller {
            factor,
            count: 0.0,
            low: 0.0,
            longest: 0.0,
            own: 0.0,
            known_for: 0.0,
            stress: 0.0,
            too_few: 0.0,
            failed_under: 0.0,
            fallen_for: RENEWED,
            levels: u32::MAX,
        }
    }
}

impl Controller {
    /// The state for the next step of `dt` (s). The number of substeps rises at once, but falls only after fewer would
    /// have sufficed for some time, and by a bounded share.
    ///
    /// Each rise shortens all edges that are stretched, which kicks the cloth. So under a steady load the number stays while
    /// the stretch is between the aim and [`Caution::most`]: otherwise it falls and rises for ever where cloth hangs at rest,
    /// which then never does rest (`cloth_at_rest_keeps_its_substeps`). And the stretch of cloth that is held stretched, or that wind
    /// holds taut, may depend on the number more steeply than the law says, so that one is too few and the next leaves nothing to correct.
    /// The number does not fall to that one again as long as the load lasts, and for [`RENEWED`] as long as it is held
    /// (`cloth_that_is_held_stretched_keeps_its_substeps`, `what_is_held_taut_comes_to_rest`).
    pub(crate) fn next(
        &self,
        rates: &Rates,
        cloth: &Cloth,
        (strain_bound, caution): (StrainBound, Caution),
        load: &Load,
        dt: f32,
    ) -> Controller {
        let stress = load.stress(cloth);
        let lasts = (stress - self.stress).abs() < STEADY * self.stress;
        let will_be_stopped = will_be_stopped(cloth, load);
        let factor = match self.count == 0.0 {
            // Nothing but a first step that was rejected has taught it more.
            true => caution.first_factor.max(self.factor),
            false if will_be_stopped => self.factor.max(STOPPED),
            false => self.factor,
        };
        let asked_at = |aim| Controller { factor, ..*self }.asked(rates, cloth, (strain_bound, Caution { aim, ..caution }), load);
        let rises_slowly = self.count > 0.0 && !cloth.has_pins() && !will_be_stopped;
        let most = if rises_slowly { caution.rounded_up(RISE * self.count) } else { f64::INFINITY };
        let asked = asked_at(caution.aim).min(most);
        // Not that of a gust in the lull after it, which each step of a slow change would pass on.
        let still_fails = self.is_held() && self.fallen_for < RENEWED || lasts && CALMER * stress > self.failed_under;
        let too_few = if still_fails { self.too_few } else { 0.0 };
        let low = self.low + dt;
        let (count, low) = if asked >= self.count {
            let stays = lasts && load.is_calm(cloth) && asked_at(caution.most) <= self.count;
            (if stays { self.count } else { asked }, 0.0)
        } else if f64::from(low) > self.patience(cloth, stress, caution) {
            let least = asked_at(caution.spare * caution.aim)
                .max(caution.rounded_up(FALL * self.count))
                .max(caution.rounded_up(too_few + 1.0));
            (least.min(self.count), 0.0)
        } else {
            (self.count, low)
        };
        let has_failed = (self.is_held() || lasts) && count > self.count && self.fallen_for < TRIED.max(TRIED_STEPS * dt);
        let (too_few, failed_under) = if has_failed { (too_few.max(self.count), stress) } else { (too_few, self.failed_under) };
        let fallen_for = if count < self.count { 0.0 } else { self.fallen_for + dt };
        Controller { factor, count, low, stress, too_few, failed_under, fallen_for, ..*self }
    }

    /// Whether the cloth is taut between its pins, and not known to be held stretched, for which [`Controller::own_of`] has rules of its
    /// own.
    pub(crate) fn is_taut(&self, cloth: &Cloth, load: &Load) -> bool {
        cloth.has_pins() && !self.is_held() && self.factor > TAUT_FACTOR && load.is_calm(cloth)
    }

    /// Whether something holds the cloth stretched: stretch that is the fabric's own is known.
    pub(crate) fn is_held(&self) -> bool {
        self.own > 0.0
    }

    /// Time (s) for which fewer substeps must have sufficed under a membrane `stress` (N/m) before their number is lowered. What is
    /// held shows what fewer leave once a transverse wave, at the speed `sqrt(sigma/rho)`, has come from its middle to what holds it.
    fn patience(&self, cloth: &Cloth, stress: f64, caution: Caution) -> f64 {
        let settled = (0.5 * cloth.extents.extent * (cloth.density / stress).sqrt()).min(SETTLED);
        if self.is_held() { caution.patience.max(settled) } else { caution.patience }
    }

    /// The strain beyond the fabric's own that the law predicts for substeps of at most `longest` (s).
    pub(crate) fn expected(&self, rates: &Rates, cloth: &Cloth, load: &Load, longest: f32) -> f64 {
        self.factor * rates.strain(load.stress(cloth), f64::from(longest))
    }

    /// The state after a step with this number of substeps per second.
    pub(crate) fn after(&self, rate: f64) -> Controller {
        Controller { longest: self.longest.max(1.0 / rate), ..*self }
    }

    /// The number of levels of the last step, if there was one.
    pub(crate) fn levels(&self) -> Option<usize> {
        (self.levels != u32::MAX).then_some(self.levels as usize)
    }

    /// The state for another quality: without the longest substep, and without what was too few for the last one.
    pub(crate) fn afresh(&self) -> Controller {
        Controller { longest: 0.0, too_few: 0.0, ..*self }
    }

    /// The state after a step from it was rejected, for which another one was `tried` and has learned its factor. A number to which it had
    /// fallen is too small.
    pub(crate) fn rejected(&self, tried: &Controller) -> Controller {
        let rejected = Controller { factor: tried.factor, ..*self };
        if tried.count >= self.count {
            return rejected;
        }
        Controller { too_few: self.too_few.max(tried.count), failed_under: tried.stress, fallen_for: 0.0, ..rejected }
    }

    /// The number of substeps in 1/60 s that the law asks for.
    fn asked(&self, rates: &Rates, cloth: &Cloth, (strain_bound, caution): (StrainBound, Caution), load: &Load) -> f64 {
        let keeping = rates.keeping(load.stress(cloth), caution.aim(strain_bound) / self.factor);
        let count = keeping.max(self.gripping(rates, cloth, load, strain_bound.share)) / SIXTIETHS;
        let most = most(rates, cloth);
        caution.rounded_up(count.min(most).max(FEWEST_SUBSTEPS)).min(most)
    }

    /// Substeps per second with which cloth that is pulled over something grips it; 0 if it is not known to be.
    ///
    /// Of its tension `T = K e`, unresolved substeps leave `T (S/S*)²`. A sleeve of radius r and length L with the friction mu
    /// stays where it is if that is at least `sigma r/(mu L)`, which [`GRIP`] bounds.
    fn gripping(&self, rates: &Rates, cloth: &Cloth, load: &Load, share: f32) -> f64 {
        let stretch = self.own - own_stretch(cloth, load.stress_without_wind(cloth), share, f64::INFINITY);
        let stress = GRIP * load.stress(cloth);
        if cloth.membrane_stiffness * stretch > stress { rates.resolving(stress / stretch) } else { 0.0 }
    }

    /// Updates the stretch that is known to be the fabric's own from the one that was measured in a step of `dt` (s), and returns it.
    /// It is known after a step `with_most` substeps, or more, that left more than the stretch aimed at. It is forgotten
    /// after [`RENEWED`] in which the load was not `calm`, and where less than it is measured by half of that aim: what was held may be
    /// slack by now, and what is measured the shortage of substeps. Where that is so just after the number of substeps has fallen, fewer
    /// make the cloth stiffer, as with levels, and the stretch that they leave is the reference from then on. Also forgets which number
    /// was too small once the cloth is slack.
    pub(crate) fn own_of(&mut self, measured: f64, with_most: bool, aim: f64, dt: f32, calm: bool) -> f64 {
        self.known_for += if calm { 0.0 } else { dt };
        // Nothing holds it stretched any more, and no number is too small for that.
        if measured < SLACK * aim {
            self.too_few = 0.0;
        }
        if with_most {
            (self.own, self.known_for) = (if measured > aim { measured } else { 0.0 }, 0.0);
        } else if self.known_for > RENEWED {
            self.own = 0.0;
        } else if measured < self.own - 0.5 * aim {
            let has_fallen = f64::from(self.fallen_for) < SETTLED;
            self.own = if has_fallen && measured > aim { measured + 0.25 * aim } else { 0.0 };
        }
        self.own
    }

    /// The state of cloth whose fabric, masses or pins were changed.
    pub(crate) fn changed(&self) -> Controller {
        Controller { own: 0.0, ..*self }
    }

    /// Updates the factor from the measured stretch beyond the fabric's own in a step of `dt` (s), for which the law with a
    /// factor of 1 predicts `law`. While something `holds` the cloth so that more substeps hardly shorten it, the factor is at
    /// most the first one.
    pub(crate) fn learn(&mut self, law: f64, excess: f64, caution: Caution, dt: f32, holds: bool) {
        let faded = self.factor * (-f64::from(dt) / caution.memory).exp();
        let seen = if law > NOTHING { excess / law } else { 0.0 };
        let most = if holds { caution.first_factor.min(self.factor) } else { f64::INFINITY };
        self.factor = faded.max(seen).min(most).max(NOTHING);
    }
}

/// Whether cloth flies into something. What flies bears no load, from which nothing is learned about what will stop it.
fn will_be_stopped(cloth: &Cloth, load: &Load) -> bool {
    let hits = cloth.density * load.collider_speed * load.collider_speed > HIT * load.weight(cloth);
    !cloth.has_pins() && load.collider_speed > load.cloth_speed && hits
}

/// Largest number of substeps as a multiple of those that resolve a stiffness beyond which nothing shows. It corresponds to 16 times that
/// stiffness.
const MUCH_STIFFER: f64 = 4.0;

/// Substeps in 1/60 s beyond which nothing is gained: `sqrt(2) S*`, where the stiffness is resolved and every visiting
/// order of the edges is stable. Cloth that is all but inextensible is not resolved: where something stretches it in spite of
/// that, more and more substeps would be asked for, of which none would help.
pub(crate) fn most(rates: &Rates, cloth: &Cloth) -> f64 {
    let resolved = std::f64::consts::SQRT_2 * rates.resolving(cloth.membrane_stiffness);
    (resolved.min(MUCH_STIFFER * rates.resolving_what_shows(cloth)) / SIXTIETHS).ceil().max(FEWEST_SUBSTEPS)
}

/// Cloth that is pulled over something keeps a tension of at least this many times the stress of its load.
const GRIP: f64 = 5.0;
/// Cloth is slack if it is stretched by less than this share of the stretch aimed at.
const SLACK: f64 = 0.25;
/// Time (s) after which stretch that is known to be the fabric's own is measured anew.
const RENEWED: f32 = 10.0;
/// Longest time (s) in which cloth that is held stretched settles after its number of substeps has fallen.
const SETTLED: f64 = 0.5;

#[cfg(test)]
#[path = "../../tests/unit/step_controller.rs"]
mod tests;
