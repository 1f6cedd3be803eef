//! Bounding boxes of features, stored by coordinate, so that one box is compared with as many others as there are SIMD
//! lanes.

use std::ops::Range;

use glam::Vec3A;

use super::workers::Workers;
use crate::simd::{MAX_LANES, Registers};

/// Least number of boxes that are worth a part of a loop.
const GRAIN: usize = 64;

/// Lower and upper bounds (m) per coordinate of many boxes.
#[derive(Debug, Default)]
pub(super) struct Boxes {
    low: [Vec<f32>; 3],
    high: [Vec<f32>; 3],
}

impl Boxes {
    /// Sets the boxes of some items; `of` returns that of an item.
    pub(super) fn bound(&mut self, items: Range<usize>, workers: Workers<'_>, of: impl Fn(usize) -> [Vec3A; 2] + Sync) {
        // Groups of lanes may extend beyond the last item.
        let count = self.low[0].len().max(items.end + MAX_LANES);
        let part = workers.part(items.len(), GRAIN);
        let bounds = [&mut self.low, &mut self.high].map(|bounds| {
            bounds.each_mut().map(|of| {
                of.resize(count, 0.0);
                of[items.clone()].chunks_mut(part)
            })
        });
        let [[low_x, low_y, low_z], [high_x, high_y, high_z]] = bounds;
        let parts = low_x.zip(low_y).zip(low_z).zip(high_x.zip(high_y).zip(high_z)).enumerate();
        workers.each(parts, |(index, (((low_x, low_y), low_z), ((high_x, high_y), high_z)))| {
            for k in 0..low_x.len() {
                let [low, high] = of(items.start + part * index + k);
                [low_x[k], low_y[k], low_z[k]] = low.to_array();
                [high_x[k], high_y[k], high_z[k]] = high.to_array();
            }
        });
    }

    /// Sets the box of an item.
    pub(super) fn set(&mut self, item: usize, [low, high]: [Vec3A; 2]) {
        for k in 0..3 {
            (self.low[k][item], self.high[k][item]) = (low[k], high[k]);
        }
    }

    #[inline(always)]
    pub(super) fn get(&self, item: usize) -> [Vec3A; 2] {
        let (low, high) = (&self.low, &self.high);
        [Vec3A::new(low[0][item], low[1][item], low[2][item]), Vec3A::new(high[0][item], high[1][item], high[2][item])]
    }

    /// Which of the boxes from `first` on, at most `count` and at most one per lane, touch a box, as one bit each.
    #[inline(always)]
    pub(super) fn touching<L: Registers>(&self, first: usize, count: usize, [low, high]: [Vec3A; 2]) -> u32 {
        let x = self.overlap::<L>(0, first, low.x, high.x);
        let y = self.overlap::<L>(1, first, low.y, high.y);
        let z = self.overlap::<L>(2, first, low.z, high.z);
        L::bits(L::and(x, L::and(y, z))) & ((1_u32 << count.min(L::LANES)) - 1)
    }

    #[inline(always)]
    fn overlap<L: Registers>(&self, axis: usize, first: usize, low: f32, high: f32) -> L::Mask {
        let lanes = first..first + L::LANES;
        let (from, to) = (L::from_slice(&self.low[axis][lanes.clone()]), L::from_slice(&self.high[axis][lanes]));
        L::and(from.lt(L::splat(high)), L::splat(low).lt(to))
    }
}
