//! As many substeps as keep a promise: chosen before a step from what acts on the cloth, corrected after it by what was measured.

use crate::kernels::statistics::Statistics;
use crate::model::cloth::Cloth;
use crate::options::Quality;
use crate::record::recorded;
use crate::step::load::Load;
use crate::step::substep_count::{FRAMES, Rates};

/// Fewest substeps in 1/60 s.
pub(crate) const LEAST: f64 = 5.0;
/// Share of the promised stretch that is aimed at.
const AIM: f64 = 0.7;
/// Measured strain over the law's, before anything was measured.
const FIRST_FACTOR: f64 = 0.3;
/// Time (s) in which that is forgotten, where it turns out to be less.
const MEMORY: f64 = 0.5;
/// Time (s) that fewer substeps must have done for, before fewer are taken; and as few as this share of those before, at once.
const PATIENCE: f64 = 0.1;
const FALL: f64 = 0.8;
/// Strain that is none, and the least factor.
const NOTHING: f64 = 1e-9;

/// A stretch that this share of the area is not to exceed beyond the fabric's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Promise {
    pub stretch: f32,
    pub share: f32,
}

impl Promise {
    pub(crate) fn of(quality: Quality) -> Option<Promise> {
        match quality {
            Quality::Strain(stretch) => Some(Promise { stretch, share: Quality::MOST_OF_THE_AREA }),
            Quality::Hold { stretch, share } => Some(Promise { stretch, share }),
            _ => None,
        }
    }
}

/// What the substeps of the next step follow from, besides what acts during it.
///
/// Below the resolved substep the strain beyond the fabric's own is `f (2 sigma/K) (S*/S)²`: a law for a sheet hung by an edge, with a
/// factor `f` for everything else about the scene, which is measured. So `S = S* sqrt(2 sigma f / (K tau))`, in which K cancels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Controller {
    factor: f64,
    /// Substeps in 1/60 s of the last step; 0 before the first.
    count: f64,
    /// For how long (s) fewer would have done.
    low: f64,
}

recorded!(Controller { factor, count, low });

impl Default for Controller {
    fn default() -> Controller {
        Controller { factor: FIRST_FACTOR, count: 0.0, low: 0.0 }
    }
}

impl Controller {
    /// What the next step of `dt` (s) takes: at once as many as it asks for, but fewer only after they would have done for a while, and
    /// not many fewer.
    pub(crate) fn next(&self, rates: &Rates, cloth: &Cloth, promise: Promise, load: &Load, dt: f32) -> Controller {
        let asked = self.asked(rates, cloth, promise, load);
        let low = self.low + f64::from(dt);
        let (count, low) = match low > PATIENCE {
            _ if asked >= self.count => (asked, 0.0),
            true => (asked.max(rounded_up(FALL * self.count)).min(self.count), 0.0),
            false => (self.count, low),
        };
        Controller { count, low, ..*self }
    }

    /// Substeps in 1/60 s of the step that it is for.
    pub(crate) fn count(&self) -> f64 {
        self.count
    }

    /// The strain beyond the fabric's own that is expected of substeps of at most `longest` (s).
    pub(crate) fn expected(&self, rates: &Rates, cloth: &Cloth, load: &Load, longest: f32) -> f64 {
        self.factor * rates.strain(load.stress(cloth), f64::from(longest))
    }

    /// With another number of substeps in 1/60 s.
    pub(crate) fn with_count(&self, count: f64) -> Controller {
        Controller { count, ..*self }
    }

    /// As many as the law asks for.
    fn asked(&self, rates: &Rates, cloth: &Cloth, promise: Promise, load: &Load) -> f64 {
        let count = rates.keeping(load.stress(cloth), AIM * f64::from(promise.stretch) / self.factor) / FRAMES;
        let most = most(rates, cloth);
        rounded_up(count.min(most).max(LEAST)).min(most)
    }

    /// Learns by how much a step of `dt` (s) exceeded the fabric's own stretch, with substeps of at most `longest` (s).
    pub(crate) fn learn(&mut self, rates: &Rates, cloth: &Cloth, load: &Load, excess: f64, longest: f32, dt: f32) {
        let law = rates.strain(load.stress(cloth), f64::from(longest));
        let faded = self.factor * (-f64::from(dt) / MEMORY).exp();
        self.factor = if law > NOTHING { faded.max(excess / law) } else { faded }.max(NOTHING);
    }
}

/// Substeps in 1/60 s past which there is nothing to gain: the stiffness is resolved, with a margin that is always stable.
pub(crate) fn most(rates: &Rates, cloth: &Cloth) -> f64 {
    (std::f64::consts::SQRT_2 * rates.resolving(cloth.stretch) / FRAMES).ceil().max(LEAST)
}

/// The stretch of a share of the area beyond the fabric's own: `2 rho ((|g| + a_pin) L + v²)/K`, what a sheet that hangs or is swung has
/// when every edge is as stiff as its fabric. Of what is measured a tenth is always taken for excess: the fabric's own is an estimate.
pub(crate) fn excess(cloth: &Cloth, load: &Load, seen: &Statistics, share: f32) -> f64 {
    let measured = f64::from(seen.stretch_of(f64::from(share)));
    let own = 2.0 * load.stress_without_wind(cloth) / cloth.stretch;
    (measured - own).max(0.1 * measured)
}

/// Up to the next of `ceil(2^(k/4))`: a breeze does not change the substeps in every step, and any of them can be asked for again as
/// [`Quality::Substeps`].
fn rounded_up(count: f64) -> f64 {
    let power = (4.0 * count.log2()).floor();
    let [below, above] = [power, power + 1.0].map(|power| (0.25 * power).exp2().ceil());
    if below >= count { below } else { above }
}
