//! What a motion is compared with at the end of each step: how fast and how long everything in the scene together can make it.
//!
//! Nothing is read back for that, so the bounds come from what is known beforehand, and they only grow until the state is set again.
//! Speeds that can be explained add up: what the cloth was given, `g t` of a free fall, the fastest wind, pin and collider so far, and
//! what elasticity can give. Cloth whose edges are all stretched by a strain e has the energy `1/2 sum k l0² e²`, which becomes a speed of
//! `e sqrt(sum k l0² / M)`, the speed of the fabric's stress waves or thereabouts; and no edge moves its ends by more than its own
//! stretch in a substep, `e l0 / h`. The lesser of the two, at a strain of 1, is what it can give. Bending kicks no shape by more than twice
//! itself in a substep, and neighbors are no farther from a plane than an edge is long: `2 l0 / h`. The bound is [`MARGIN`] times the sum,
//! 64 times the energy, and it is on all of the cloth: the tip of a whip may be faster.
//!
//! Lengths that can be explained are the cloth's own, what its load and its speed stretch it by if it is soft, and what one sweep
//! leaves if it has few substeps; and as far as a collider goes it may carry a part of the cloth along. Pins that are led apart explain
//! nothing: cloth that they tear to eight times its size has been torn.
//!
//! An instability grows by a factor in every substep, so that it is seen a few substeps later than by a tighter bound.

use glam::Vec4;

use crate::attributes::Attributes;
use crate::kernels::params::Params;
use crate::model::cloth::Cloth;
use crate::options::{Method, Options};
use crate::record::recorded;
use crate::step::load::{pressure, travel};
use crate::step::motion::Motion;
use crate::step::substep_count::{Length, Rates};

/// Times what is explained.
const MARGIN: f64 = 8.0;
/// Of smaller cloth (m) no edge is told from the rounding of its place.
const LEAST_EXTENT: f64 = 1e-6;
/// Peak stress in motion over the static stress `rho g L`.
const TRANSIENT: f64 = 5.0;
/// A step looks at one part of so many of the edges, the next at the next, but no fewer than [`LEAST`]: both are in `stages/watch.wgsl`. What is
/// out of cache costs more to look at than to sweep; and what tears, tears slowly.
pub(crate) const TURNS: usize = 128;
pub(crate) const LEAST: usize = 64;

/// What is known of the motion so far.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Watch {
    /// One over the mass (1/kg) of the vertices that are free.
    per_mass: f64,
    /// Speed (m/s) that a strain of 1 can give; infinite if the fabric is inextensible or the method has no stiffness.
    wave: f64,
    /// Whether it resists bending.
    bends: bool,
    /// Least stiffness (N/m) of any part of it; infinite likewise.
    softest: f64,
    /// What the state was set with: the fastest vertex (m/s), and by how much an edge was longer (m) than the longest at rest.
    speed: f64,
    spread: f64,
    /// Since then: `g t` (m/s), the fastest (m/s) of wind, pins and colliders, and how far (m) colliders have gone, in each step the one that
    /// went farthest.
    fallen: f64,
    fastest: f64,
    gone: f64,
}

recorded!(Watch { speed, spread, fallen, fastest, gone } but { per_mass, wave, bends, softest });

/// Which pin and which collider is led fastest in a step, by their places in the lists, and how fast (m/s).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Led {
    pub pin: (usize, f64),
    pub collider: (usize, f64),
}

impl Watch {
    pub(crate) fn new(cloth: &Cloth, options: &Options) -> Watch {
        let free = cloth.rest.iter().zip(&cloth.mass).filter(|(x, _)| x.w > 0.0);
        let mass: f64 = free.map(|(_, &mass)| f64::from(mass)).sum();
        let per_mass = if mass > 0.0 { 1.0 / mass } else { 0.0 };
        let elastic: f64 = cloth.swept().iter().map(|link| link.stiffness * f64::from(link.rest).powi(2)).sum();
        let scales = options.edge_scale.iter().flatten().filter(|&&scale| scale > 0.0);
        let softest = cloth.stretch * f64::from(scales.copied().fold(1.0, f32::min));
        // Relaxation knows no stiffness.
        let (wave, softest) = match options.method {
            Method::Relaxation { .. } => (f64::INFINITY, f64::INFINITY),
            _ => ((elastic * per_mass).sqrt(), softest),
        };
        Watch { per_mass, wave, bends: options.fabric.bending > 0.0, softest, ..Watch::default() }
    }

    /// Begins anew from a state in the cloth's order: positions (m) and velocities (m/s).
    pub(crate) fn placed(&self, cloth: &Cloth, x: &[Vec4], v: &[Vec4]) -> Watch {
        let speed = v.iter().map(|v| v.truncate().as_dvec3().length()).fold(0.0, f64::max);
        let longest = cloth.swept().iter().map(|link| {
            let [a, b] = link.ends.map(|end| x[end as usize].truncate().as_dvec3());
            a.distance(b)
        });
        let spread = (longest.fold(0.0, f64::max) - f64::from(cloth.longest)).max(0.0);
        Watch { speed, spread, fallen: 0.0, fastest: 0.0, gone: 0.0, ..*self }
    }

    /// Of the same cloth and options, with what was met until then.
    pub(crate) fn with_past(&self, past: &Watch) -> Watch {
        Watch { per_mass: self.per_mass, wave: self.wave, bends: self.bends, softest: self.softest, ..*past }
    }

    /// With a step of `dt` (s) that starts from `motion`; and what is fastest in it.
    pub(crate) fn meet(&self, cloth: &Cloth, motion: &Motion, attributes: &Attributes, dt: f64) -> (Watch, Led) {
        let mut led = Led::default();
        let targets = attributes.pin_targets.iter().flatten().zip(&motion.pins);
        for (index, (to, from)) in targets.enumerate() {
            let speed = (*to - cloth.origin).as_dvec3().distance(from.as_dvec3()) / dt;
            if speed > led.pin.1 {
                led.pin = (index, speed);
            }
        }
        for (index, (now, last)) in motion.followed(&attributes.colliders).enumerate() {
            let speed = travel(&now.shape, &last.shape) / dt;
            if speed > led.collider.1 {
                led.collider = (index, speed);
            }
        }
        let wind = attributes.wind.as_dvec3().length();
        let fastest = self.fastest.max(wind).max(led.pin.1).max(led.collider.1);
        let fallen = self.fallen + attributes.gravity.as_dvec3().length() * dt;
        let gone = self.gone + led.collider.1 * dt;
        (Watch { fallen, fastest, gone, ..*self }, led)
    }

    /// The bounds of a step: on the cloth's speed (m/s), and on an edge's length (m).
    pub(crate) fn bounds(&self, cloth: &Cloth, rates: &Rates, attributes: &Attributes, length: Length) -> (f32, f32) {
        let h = f64::from(length.h);
        let longest = f64::from(cloth.longest);
        let elastic = if self.bends { 2.0 * longest / h } else { self.wave.min(longest / h) };
        let explained = self.speed + self.fallen + self.fastest + elastic + self.spread / h;
        let speed = coarse(MARGIN * explained);
        let extent = cloth.extents.length();
        if extent < LEAST_EXTENT {
            return (speed, f32::MAX);
        }
        let stress = TRANSIENT * (cloth.density * attributes.gravity.as_dvec3().length() + pressure(attributes)) * cloth.extent;
        let stretch =
            extent * (stress / self.softest + explained / self.wave) + longest * rates.strain(stress, f64::from(length.longest));
        (speed, coarse(MARGIN * (extent + stretch + self.spread) + self.gone + f64::from(speed) * h))
    }

    /// Tells a step its bounds.
    pub(crate) fn tell(&self, params: &mut Params, (speed, length): (f32, f32)) {
        params.per_length = (1.0 / (f64::from(speed) * f64::from(params.h))) as f32;
        params.per_mass = self.per_mass as f32;
        params.longest = length;
    }
}

/// Rounded up to a power of two, so that a steady scene sends the same numbers again and again; no more than single precision can square.
fn coarse(bound: f64) -> f32 {
    // Not a number only where infinities meet.
    let bound = if bound.is_nan() { f64::INFINITY } else { bound };
    bound.clamp(1e-3, 1e18).log2().ceil().exp2() as f32
}
