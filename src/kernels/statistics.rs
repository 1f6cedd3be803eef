//! Statistics of a state: how far the cloth's area is stretched, and how fast its vertices move. All sums are of
//! integers, so they do not depend on the order of summation.

use bytemuck::{Pod, Zeroable};
use glam::{BVec3, Vec3};

use crate::kernels::rigid::Rigid;
use crate::record::recorded;

/// Number of classes of a histogram.
pub(crate) const CLASSES: usize = 128;
/// Bits of an f32 that do not affect its class: all but the exponent and the first three bits of the mantissa, which
/// gives eight classes per octave.
pub(crate) const BITS: u32 = f32::MANTISSA_DIGITS - 1 - 3;
/// The least stretch that is told from none: the lower end of class 1.
pub(crate) const MIN_STRETCH: f32 = 1.0 / 4096.0;
/// The least speed (m/s) that is told from rest: the lower end of class 1.
pub(crate) const MIN_SPEED: f32 = 1.0 / 1024.0;
/// The total area of all gauges as an integer.
pub(crate) const WHOLE: u32 = 1 << 30;
/// 1 as a fixed-point number, for means that are summed as integers.
pub(crate) const ONE: f32 = (1 << 26) as f32;
/// Larger stretches count as this in the mean, so that the sum cannot overflow.
pub(crate) const MAX_STRETCH: f32 = 32.0;
/// Larger speeds (m/s) count as this in the sum of squares.
pub(crate) const SLOW: f32 = 0.01;
/// 1 as a fixed-point number in that sum.
pub(crate) const SLOW_PARTS: f32 = 128.0;

/// An edge that is shorter than this share of its length at rest is crushed: cloth would have buckled.
pub(crate) const CRUSHED: f32 = 0.97;

/// An edge by whose stretch the cloth's strain is measured.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct StrainGauge {
    pub ends: [u32; 2],
    /// One over the rest length (1/m).
    pub inverse_rest: f32,
    /// The area that the edge stands for, in units of 1/[`WHOLE`] of the total.
    pub weight: u32,
}

/// Histograms and extremes of a state.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Statistics {
    /// Area by stretch, in units of 1/[`WHOLE`].
    pub stretch: [u32; CLASSES],
    /// Number of free vertices by speed relative to the drift ([`Params::drift`](crate::kernels::params::Params)).
    pub speed: [u32; CLASSES],
    /// Mean stretch of the area, in units of 1/[`ONE`]; stretches beyond [`MAX_STRETCH`] count as that.
    pub mean_stretch: u32,
    /// The largest stretch, as the bits of an f32.
    pub worst_stretch: u32,
    /// Sum of `min((v / SLOW)², 1)` over the free vertices, in units of 1/[`SLOW_PARTS`].
    pub slow: u32,
    /// The largest such speed (m/s), as the bits of an f32.
    pub fastest: u32,
    /// The lowest corner of the vertices' bounding box (m), as [`ordered`] numbers.
    pub low: [u32; 3],
    /// Its highest corner.
    pub high: [u32; 3],
    /// Area that is [`CRUSHED`], in units of 1/[`WHOLE`].
    pub crushed: u32,
}

impl Default for Statistics {
    /// The statistics of no vertices and no gauges.
    fn default() -> Statistics {
        Statistics {
            stretch: [0; CLASSES],
            speed: [0; CLASSES],
            mean_stretch: 0,
            worst_stretch: 0,
            slow: 0,
            fastest: 0,
            low: [u32::MAX; 3],
            high: [0; 3],
            crushed: 0,
        }
    }
}

recorded!(Statistics { stretch, speed, mean_stretch, worst_stretch, slow, fastest, low, high, crushed });

impl Statistics {
    /// Combines the statistics of two parts.
    pub(crate) fn with(mut self, other: &Statistics) -> Statistics {
        self.stretch.iter_mut().zip(&other.stretch).for_each(|(sum, more)| *sum += more);
        self.speed.iter_mut().zip(&other.speed).for_each(|(sum, more)| *sum += more);
        self.mean_stretch += other.mean_stretch;
        self.worst_stretch = self.worst_stretch.max(other.worst_stretch);
        self.slow += other.slow;
        self.fastest = self.fastest.max(other.fastest);
        self.low = std::array::from_fn(|axis| self.low[axis].min(other.low[axis]));
        self.high = std::array::from_fn(|axis| self.high[axis].max(other.high[axis]));
        self.crushed += other.crushed;
        self
    }

    /// The statistics after a rigid motion of the whole cloth. The bounding box becomes that of the old box's image,
    /// which may be larger than necessary.
    pub(crate) fn warp(&mut self, rigid: &Rigid) {
        let [low, high] = [self.low, self.high].map(unordered);
        if !(low.is_finite() && high.is_finite()) {
            return;
        }
        let corner = |k: usize| rigid.point(Vec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), high, low));
        let around = |(low, high): (Vec3, Vec3), x: Vec3| (low.min(x), high.max(x));
        let (low, high) = (0..8).map(corner).fold((Vec3::INFINITY, Vec3::NEG_INFINITY), around);
        (self.low, self.high) = (low.to_array().map(ordered), high.to_array().map(ordered));
    }

    /// The stretch that this share of the area does not exceed.
    pub(crate) fn stretch_of(&self, share: f64) -> f32 {
        let counted: u64 = self.stretch[1..].iter().map(|&area| u64::from(area)).sum();
        let whole = u64::from(WHOLE).max(counted);
        let exceeded = (1.0 - share) * whole as f64;
        quantile(&self.stretch, MIN_STRETCH, exceeded).min(f32::from_bits(self.worst_stretch))
    }

    /// The speed (m/s) that this share of the free vertices does not exceed.
    pub(crate) fn speed_of(&self, share: f64) -> f32 {
        let counted: u64 = self.speed.iter().map(|&count| u64::from(count)).sum();
        quantile(&self.speed, MIN_SPEED, (1.0 - share) * counted as f64).min(f32::from_bits(self.fastest))
    }

    /// Mean stretch of the area.
    pub(crate) fn mean_stretch(&self) -> f32 {
        self.mean_stretch as f32 / ONE
    }

    /// Root mean square of the speeds (m/s). Those in classes above [`SLOW`] count as the upper ends of their classes, so that cloth of
    /// which a part moves does not seem to be at rest.
    pub(crate) fn rms_speed(&self) -> f32 {
        let counted: u32 = self.speed.iter().sum();
        let fastest = f32::from_bits(self.fastest);
        let fast = (class_of(SLOW, MIN_SPEED) + 1..CLASSES).map(|class| {
            let most = if class + 1 < CLASSES { begin(class + 1, MIN_SPEED).min(fastest) } else { fastest };
            self.speed[class] as f32 * (most * most - SLOW * SLOW)
        });
        let slow = SLOW * SLOW * self.slow as f32 / SLOW_PARTS;
        ((slow + fast.sum::<f32>()) / counted.max(1) as f32).sqrt()
    }
}

/// The class of a stretch or a speed. There are eight classes per octave from `least` on, formed from the leading bits
/// of the number. Class 0 holds all smaller values, the last class all larger ones.
pub(crate) fn class_of(value: f32, least: f32) -> usize {
    (value.to_bits() >> BITS).saturating_sub((least.to_bits() >> BITS) - 1).min(CLASSES as u32 - 1) as usize
}

/// The lower end of a class other than 0.
fn begin(class: usize, least: f32) -> f32 {
    f32::from_bits(((least.to_bits() >> BITS) + class as u32 - 1) << BITS)
}

/// The value that an amount `exceeded` of a histogram lies above, interpolated linearly within a class.
fn quantile(histogram: &[u32; CLASSES], least: f32, exceeded: f64) -> f32 {
    let mut above = 0.0;
    for class in (1..CLASSES).rev() {
        let here = f64::from(histogram[class]);
        if above + here > exceeded {
            let [low, high] = [begin(class, least), begin(class + 1, least)].map(f64::from);
            return (high - (high - low) * (exceeded - above) / here) as f32;
        }
        above += here;
    }
    least
}

/// The stretch of an edge with this length (m); 0 if it is compressed.
pub(crate) fn stretch(length: f32, inverse_rest: f32) -> f32 {
    (length * inverse_rest).max(1.0) - 1.0
}

/// Whether an edge with this length (m) is crushed.
pub(crate) fn is_crushed(length: f32, inverse_rest: f32) -> bool {
    length * inverse_rest < CRUSHED
}

/// Maps a number to an integer so that integers are ordered like the numbers.
pub(crate) fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

/// The inverse of [`ordered`], for each component.
pub(crate) fn unordered(key: [u32; 3]) -> Vec3 {
    Vec3::from(key.map(|key| f32::from_bits(if key >> 31 == 1 { key & !(1 << 31) } else { !key })))
}

#[cfg(test)]
#[path = "../../tests/unit/kernels_statistics.rs"]
mod tests;
