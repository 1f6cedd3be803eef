//! Statistics of stretch and speed, computed on the CPU.

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use crate::HAS_THREADS;
use crate::kernels::integrate::xyz;
use crate::kernels::statistics::{
    MAX_STRETCH, MIN_SPEED, MIN_STRETCH, ONE, SLOW, SLOW_PARTS, Statistics, StrainGauge, WHOLE, class_of, is_crushed, ordered,
    stretch,
};
use crate::simd::{self, Loop, MAX_LANES, Registers, Width, load_vectors, vector_of_lane};

/// Gauges or vertices per task.
const GRAIN: usize = 4096;
/// Lengths are computed in blocks of this size with SIMD, and then sorted into histogram classes one by one.
const BLOCK: usize = 256;

/// The state that statistics are taken of.
pub(crate) struct Observed<'a> {
    /// Positions (m), w the inverse mass.
    pub x: &'a [Vec4],
    /// Displacements (m) over the last substep.
    pub u: &'a [Vec4],
    /// Displacement (m) over the last substep, of the pins or of the course of cloth without any, which speeds are relative to.
    pub drift: Vec3A,
    /// The last substep (s).
    pub h: f32,
    pub width: Width,
}

impl Observed<'_> {
    /// Computes the statistics. With `alone` only this thread is used.
    pub(crate) fn statistics(&self, gauges: &[StrainGauge], alone: bool) -> Statistics {
        let of_gauges = |gauges| self.stretches(gauges);
        let of_vertices = |(x, u)| Observed { x, u, ..*self }.speeds();
        let together = |a: Statistics, b: Statistics| a.with(&b);
        if alone || !HAS_THREADS {
            let vertices = self.x.chunks(GRAIN).zip(self.u.chunks(GRAIN));
            return gauges.chunks(GRAIN).map(of_gauges).chain(vertices.map(of_vertices)).fold(Statistics::default(), together);
        }
        let vertices = self.x.par_chunks(GRAIN).zip(self.u.par_chunks(GRAIN));
        gauges.par_chunks(GRAIN).map(of_gauges).chain(vertices.map(of_vertices)).reduce(Statistics::default, together)
    }

    fn stretches(&self, gauges: &[StrainGauge]) -> Statistics {
        let mut seen = Statistics::default();
        let (mut sum, mut worst) = (0.0_f32, 0.0_f32);
        for gauges in gauges.chunks(BLOCK) {
            let mut lengths = [0.0; BLOCK];
            simd::run(self.width, EdgeLengths { x: self.x, gauges, lengths: &mut lengths });
            for (&length, gauge) in lengths.iter().zip(gauges) {
                let stretch = stretch(length, gauge.inverse_rest);
                seen.stretch[class_of(stretch, MIN_STRETCH)] += gauge.weight;
                sum += gauge.weight as f32 * stretch.min(MAX_STRETCH);
                worst = worst.max(stretch);
                seen.crushed += if is_crushed(length, gauge.inverse_rest) { gauge.weight } else { 0 };
            }
        }
        seen.mean_stretch = (sum * (ONE / WHOLE as f32)).round() as u32;
        seen.worst_stretch = worst.to_bits();
        seen
    }

    fn speeds(&self) -> Statistics {
        let mut seen = Statistics::default();
        let (mut sum, mut fastest) = (0.0_f32, 0.0_f32);
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for (x, u) in self.x.chunks(BLOCK).zip(self.u.chunks(BLOCK)) {
            let mut lengths = [0.0; BLOCK];
            simd::run(self.width, Displacements { u, drift: self.drift.extend(0.0), lengths: &mut lengths });
            for (&length, &x) in lengths.iter().zip(x) {
                let at = xyz(x);
                (low, high) = (low.min(at), high.max(at));
                // Pins do not count: their motion is prescribed.
                let (speed, counts) = if x.w > 0.0 { (length / self.h, 1) } else { (0.0, 0) };
                seen.speed[class_of(speed, MIN_SPEED)] += counts;
                sum += (speed * speed).min(SLOW * SLOW);
                fastest = fastest.max(speed);
            }
        }
        seen.slow = (sum * (SLOW_PARTS / (SLOW * SLOW))).round() as u32;
        seen.fastest = fastest.to_bits();
        (seen.low, seen.high) = (low.to_array().map(ordered), high.to_array().map(ordered));
        seen
    }
}

/// The lengths (m) of the edges that gauges measure.
struct EdgeLengths<'a> {
    x: &'a [Vec4],
    gauges: &'a [StrainGauge],
    lengths: &'a mut [f32],
}

impl Loop for EdgeLengths<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        for (gauges, lengths) in self.gauges.chunks(L::LANES).zip(self.lengths.chunks_mut(L::LANES)) {
            let mut d = [L::splat(0.0); 4];
            for k in 0..4 {
                let (mut a, mut b) = ([Vec4::ZERO; 4], [Vec4::ZERO; 4]);
                for j in 0..L::VECTORS {
                    // Unused lanes repeat the last gauge.
                    let gauge = &gauges[(k * L::VECTORS + j).min(gauges.len() - 1)];
                    (a[j], b[j]) = (self.x[gauge.ends[0] as usize], self.x[gauge.ends[1] as usize]);
                }
                d[k] = L::from_vectors(a) - L::from_vectors(b);
            }
            store_lengths(d, lengths);
        }
    }
}

/// The lengths (m) of displacements relative to the drift.
struct Displacements<'a> {
    u: &'a [Vec4],
    drift: Vec4,
    lengths: &'a mut [f32],
}

impl Loop for Displacements<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        for (u, lengths) in self.u.chunks(L::LANES).zip(self.lengths.chunks_mut(L::LANES)) {
            let (mut d, drift) = (load_vectors::<L>(u), L::repeat(self.drift));
            for d in &mut d {
                *d = *d - drift;
            }
            store_lengths(d, lengths);
        }
    }
}

/// Stores the lengths of one vector per lane, in the order in which the vectors lie in memory.
#[inline(always)]
fn store_lengths<L: Registers>(vectors: [L; 4], lengths: &mut [f32]) {
    let d = L::transpose(vectors);
    let by_lane = d.dot(d).sqrt().to_vectors();
    let by_lane: [f32; MAX_LANES] = bytemuck::cast(by_lane);
    for lane in 0..L::LANES {
        lengths[vector_of_lane(lane, L::LANES)] = by_lane[lane];
    }
}
