//! What a moving cloth is judged by: how far its area is stretched, and how fast it moves. All sums are of integers, so that they are
//! the same in any order.

use bytemuck::{Pod, Zeroable};
use glam::{BVec3, Vec3};

use crate::kernels::rigid::Rigid;
use crate::record::recorded;

/// Classes of a histogram.
pub(crate) const CLASSES: usize = 128;
/// Bits of a number that are the same to a class: all but its exponent and the first three after it, which make eight classes an octave.
pub(crate) const BITS: u32 = f32::MANTISSA_DIGITS - 1 - 3;
/// Least stretch that is told from none, and least speed (m/s) from rest: the lower ends of the class 1.
pub(crate) const LEAST_STRETCH: f32 = 1.0 / 4096.0;
pub(crate) const LEAST_SPEED: f32 = 1.0 / 1024.0;
/// The area of all gauges, and the number of all vertices, in the parts that are counted.
pub(crate) const WHOLE: u32 = 1 << 30;
/// One, of a mean that is summed up in integers, and the largest stretch in it, which keeps the sum from overflowing.
pub(crate) const ONE: f32 = (1 << 26) as f32;
pub(crate) const MOST: f32 = 32.0;
/// Speed (m/s) that squares of speeds are summed up to; who is faster is counted so fast.
pub(crate) const SLOW: f32 = 0.01;
pub(crate) const SLOW_PARTS: f32 = 128.0;

/// An edge by which strain is told.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct StrainGauge {
    pub ends: [u32; 2],
    /// One over the rest length (1/m).
    pub inverse_rest: f32,
    /// Its share of the area, in parts of [`WHOLE`].
    pub weight: u32,
}

/// What is counted of a state.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Statistics {
    /// Area by stretch, in parts of [`WHOLE`]; the first class is what is left of it.
    pub stretch: [u32; CLASSES],
    /// Free vertices by speed.
    pub speed: [u32; CLASSES],
    /// Mean stretch of the area, what is beyond [`MOST`] counted as that, in parts of [`ONE`].
    pub mean_stretch: u32,
    /// Bits of the largest stretch.
    pub worst_stretch: u32,
    /// Sum of `min((v / SLOW)², 1)` over the free vertices, in parts of [`SLOW_PARTS`].
    pub slow: u32,
    /// Bits of the largest speed (m/s).
    pub fastest: u32,
    /// The box around the vertices (m), as [`ordered`] numbers: its lowest and its highest corner.
    pub low: [u32; 3],
    pub high: [u32; 3],
}

impl Default for Statistics {
    fn default() -> Statistics {
        Statistics::NONE
    }
}

recorded!(Statistics { stretch, speed, mean_stretch, worst_stretch, slow, fastest, low, high });

impl Statistics {
    /// Of nothing.
    pub(crate) const NONE: Statistics = Statistics {
        stretch: [0; CLASSES],
        speed: [0; CLASSES],
        mean_stretch: 0,
        worst_stretch: 0,
        slow: 0,
        fastest: 0,
        low: [u32::MAX; 3],
        high: [0; 3],
    };

    /// Of two parts together.
    pub(crate) fn with(mut self, other: &Statistics) -> Statistics {
        self.stretch.iter_mut().zip(&other.stretch).for_each(|(sum, more)| *sum += more);
        self.speed.iter_mut().zip(&other.speed).for_each(|(sum, more)| *sum += more);
        self.mean_stretch += other.mean_stretch;
        self.worst_stretch = self.worst_stretch.max(other.worst_stretch);
        self.slow += other.slow;
        self.fastest = self.fastest.max(other.fastest);
        self.low = std::array::from_fn(|axis| self.low[axis].min(other.low[axis]));
        self.high = std::array::from_fn(|axis| self.high[axis].max(other.high[axis]));
        self
    }

    /// The same of a cloth that was moved as a whole: the box around it is no smaller than it was, turned.
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
        quantile(&self.stretch, LEAST_STRETCH, exceeded).min(f32::from_bits(self.worst_stretch))
    }

    /// The speed (m/s) that this share of the free vertices does not exceed.
    pub(crate) fn speed_of(&self, share: f64) -> f32 {
        let counted: u64 = self.speed.iter().map(|&count| u64::from(count)).sum();
        quantile(&self.speed, LEAST_SPEED, (1.0 - share) * counted as f64).min(f32::from_bits(self.fastest))
    }

    /// Mean stretch of the area.
    pub(crate) fn mean_stretch(&self) -> f32 {
        self.mean_stretch as f32 / ONE
    }

    /// Root of the mean square of the speeds (m/s), as long as none is above [`SLOW`].
    pub(crate) fn rms_speed(&self) -> f32 {
        let counted: u32 = self.speed.iter().sum();
        SLOW * (self.slow as f32 / SLOW_PARTS / counted.max(1) as f32).sqrt()
    }
}

/// The class of a stretch or a speed: eight to an octave from the least on, as the number's own bits have them; the first has all that
/// is less, the last all that is more.
pub(crate) fn class_of(value: f32, least: f32) -> usize {
    (value.to_bits() >> BITS).saturating_sub((least.to_bits() >> BITS) - 1).min(CLASSES as u32 - 1) as usize
}

/// What a class but the first begins with.
fn begin(class: usize, least: f32) -> f32 {
    f32::from_bits(((least.to_bits() >> BITS) + class as u32 - 1) << BITS)
}

/// What all but `exceeded` of what a histogram counts is below, evenly within a class.
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

/// How far an edge of some length (m) is stretched, 0 if it is not.
pub(crate) fn stretch(length: f32, inverse_rest: f32) -> f32 {
    (length * inverse_rest).max(1.0) - 1.0
}

/// A number whose order among others is that of `value`.
pub(crate) fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 1 { !bits } else { bits | 1 << 31 }
}

/// The values that are [`ordered`] so.
pub(crate) fn unordered(key: [u32; 3]) -> Vec3 {
    Vec3::from(key.map(|key| f32::from_bits(if key >> 31 == 1 { key & !(1 << 31) } else { !key })))
}

#[cfg(test)]
#[path = "../../tests/unit/kernels_statistics.rs"]
mod tests;
