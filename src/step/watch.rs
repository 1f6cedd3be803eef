//! Instability detection: bounds on the speed and on the length of edges that everything in the scene together can
//! explain, checked at the end of each step.
//!
//! The bounds follow from what is known before the step, so nothing has to be read back for them, and they only grow
//! until the state is set again. The explainable speed is the sum of the cloth's initial speed, `g t` of a free fall,
//! the fastest wind, pin or collider so far, and what elasticity can contribute. If all edges are stretched by a strain
//! e, they store `1/2 sum k l0² e²`, which converts to a speed of `e sqrt(sum k l0² / M)`, roughly the speed of stress
//! waves in the fabric. Also, in one substep an edge moves its ends by at most its own stretch, a speed of `e l0 / h`.
//! The smaller of the two at e = 1 is taken. With bending it is `2 l0 / h` instead: bending changes a shape by at most
//! twice its deviation from flat in a substep, and a neighbor deviates by at most an edge's length. The bound is
//! [`MARGIN`] times the sum, so 64 times in energy. It applies to the kinetic energy of all vertices that are faster than
//! that, as a share of what the whole cloth would have at that speed: the tip of a whip may be faster.
//!
//! The explainable length is the cloth's own extent, plus what its load and speed stretch it by if it is soft, plus
//! what one sweep leaves if there are few substeps, plus the distance that colliders have moved, since they may carry
//! part of the cloth along. Pins that are moved apart are not counted: cloth that they stretch to eight times its size
//! has failed.
//!
//! An instability grows by a factor per substep, so a tighter bound would detect it only a few substeps earlier.

use glam::{Vec3, Vec4};

use crate::attributes::Attributes;
use crate::kernels::params::Params;
use crate::model::cloth::Cloth;
use crate::options::{Method, Options};
use crate::record::recorded;
use crate::step::load::{Fastest, ambient_acceleration, pressure};
use crate::step::substep_count::{Length, Rates};

/// Factor between what can be explained and the bound.
const MARGIN: f64 = 8.0;
/// Extent (m) below which edges cannot be told from rounding errors of positions, so lengths are not checked.
const MIN_EXTENT: f64 = 1e-6;
/// Ratio of the peak stress in motion to the static stress `rho g L`.
pub(crate) const TRANSIENT: f64 = 5.0;
/// Each step checks one of so many parts of the edges, in turn; `stages/watch.wgsl` has the same constant. Checking an
/// edge that is out of cache costs more than sweeping it, and overstretched edges persist for many steps. On the CPU a
/// step whose vertices are all close enough together checks none.
pub(crate) const TURNS: usize = 128;
/// Minimum number of edges that a step checks; `stages/watch.wgsl` has the same constant.
pub(crate) const FEWEST_CHECKED: usize = 16;

/// What the bounds follow from: constants of the cloth, and the largest motions in the scene so far.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Watch {
    /// One over the mass of all free vertices (1/kg).
    per_mass: f64,
    /// Speed (m/s) that a strain of 1 converts to; infinite if the fabric is inextensible or the method ignores
    /// stiffness.
    wave: f64,
    /// Whether the fabric resists bending.
    bends: bool,
    /// The least stiffness (N/m) of any part of the fabric; infinite if the fabric is inextensible or the method ignores
    /// stiffness.
    softest: f64,
    /// The fastest vertex (m/s) of the state when it was set.
    speed: f64,
    /// By how much (m) the longest edge of that state exceeded the longest one at rest.
    spread: f64,
    /// Since then: the sum of `g dt` (m/s).
    fallen: f64,
    /// Since then: the fastest wind, pin or collider (m/s).
    fastest: f64,
    /// Since then: the distance (m) covered by colliders, counting the fastest one in each step.
    gone: f64,
}

recorded!(Watch { speed, spread, fallen, fastest, gone } but { per_mass, wave, bends, softest });

/// The bounds of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    /// On the cloth's speed (m/s, root mean square).
    pub speed: f32,
    /// On the length (m) of an edge.
    pub edge_length: f32,
}

recorded!(Bounds { speed, edge_length });

impl Default for Bounds {
    fn default() -> Bounds {
        Bounds { speed: f32::MAX, edge_length: f32::MAX }
    }
}

impl Watch {
    pub(crate) fn new(cloth: &Cloth, options: &Options) -> Watch {
        let free = cloth.rest.iter().zip(&cloth.mass).filter(|(x, _)| x.w > 0.0);
        let mass: f64 = free.map(|(_, &mass)| f64::from(mass)).sum();
        let per_mass = if mass > 0.0 { 1.0 / mass } else { 0.0 };
        let elastic: f64 = cloth.swept().iter().map(|link| cloth.stiffness(link) * f64::from(link.rest).powi(2)).sum();
        let scales = options.edge_scale.iter().flatten().filter(|&&scale| scale > 0.0);
        let softest = f64::from(options.fabric.stretch) * f64::from(scales.copied().fold(1.0, f32::min));
        // Relaxation knows no stiffness.
        let (wave, softest) = match options.method {
            Method::Relaxation { .. } => (f64::INFINITY, f64::INFINITY),
            _ => ((elastic * per_mass).sqrt(), softest),
        };
        Watch { per_mass, wave, bends: options.fabric.bending > 0.0, softest, ..Watch::default() }
    }

    /// Restarts from a state in the cloth's order: positions (m) and velocities (m/s).
    pub(crate) fn placed(&self, cloth: &Cloth, x: &[Vec4], v: &[Vec4]) -> Watch {
        let speed = v.iter().map(|v| v.truncate().as_dvec3().length()).fold(0.0, f64::max);
        let longest = cloth.swept().iter().map(|link| {
            let [a, b] = link.ends.map(|end| x[end as usize].truncate().as_dvec3());
            a.distance(b)
        });
        let spread = (longest.fold(0.0, f64::max) - f64::from(cloth.longest_edge)).max(0.0);
        Watch { speed, spread, fallen: 0.0, fastest: 0.0, gone: 0.0, ..*self }
    }

    /// The motions recorded in `past`, with the constants of this cloth.
    pub(crate) fn with_past(&self, past: &Watch) -> Watch {
        Watch { per_mass: self.per_mass, wave: self.wave, bends: self.bends, softest: self.softest, ..*past }
    }

    /// Adds a step of `dt` (s).
    pub(crate) fn with_step(&self, attributes: &Attributes, dt: f64, moved: &Fastest) -> Watch {
        let is_windy = attributes.air_density > 0.0 || attributes.damping > 0.0;
        let wind = if is_windy { attributes.wind.as_dvec3().length() } else { 0.0 };
        let fastest = self.fastest.max(wind).max(moved.any_pin).max(moved.any_collider);
        let fallen = self.fallen + attributes.gravity.as_dvec3().length() * dt;
        let gone = self.gone + moved.any_collider * dt;
        Watch { fallen, fastest, gone, ..*self }
    }

    /// The bounds of a step with substeps of this length.
    pub(crate) fn bounds(&self, cloth: &Cloth, rates: &Rates, attributes: &Attributes, length: Length) -> Bounds {
        let h = f64::from(length.h);
        let longest = f64::from(cloth.longest_edge);
        let elastic = if self.bends { 2.0 * longest / h } else { self.wave.min(longest / h) };
        let explained = self.speed + self.fallen + self.fastest + elastic + self.spread / h;
        let speed = coarse(MARGIN * explained);
        let extent = cloth.sides.length();
        if extent < MIN_EXTENT {
            return Bounds { speed, ..Bounds::default() };
        }
        let stress = TRANSIENT
            * (cloth.density * ambient_acceleration(attributes, Vec3::ZERO) + pressure(attributes))
            * cloth.sides.max_element();
        let stretch = extent * (stress / self.softest + explained / self.wave)
            + longest * rates.strain(stress, f64::from(length.longest_h));
        let edge_length = coarse(MARGIN * (extent + stretch + self.spread) + self.gone + f64::from(speed) * h);
        Bounds { speed, edge_length }
    }

    /// Writes the bounds into a step's parameters.
    pub(crate) fn limit(&self, params: &mut Params, Bounds { speed, edge_length }: Bounds) {
        params.per_length = (1.0 / (f64::from(speed) * f64::from(params.h))) as f32;
        params.per_mass = self.per_mass as f32;
        params.longest_edge = edge_length;
    }
}

/// Rounds up to a power of two, so that a steady scene uploads the same numbers each time. Bounded so that squares do
/// not overflow in single precision.
fn coarse(bound: f64) -> f32 {
    // NaN arises here only from operations between infinities.
    let bound = if bound.is_nan() { f64::INFINITY } else { bound };
    bound.clamp(1e-3, 1e18).log2().ceil().exp2() as f32
}
