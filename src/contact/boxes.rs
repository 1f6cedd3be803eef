//! Bounding boxes of features, stored by coordinate, so that one box is compared with as many others as there are SIMD
//! lanes.

use std::ops::Range;

use glam::Vec3A;
use rayon::prelude::*;

use crate::simd::{MAX_LANES, Registers};

/// Lower and upper bounds (m) per coordinate of many boxes.
#[derive(Debug, Default)]
pub(super) struct Boxes {
    low: [Vec<f32>; 3],
    high: [Vec<f32>; 3],
}

impl Boxes {
    /// Sets the boxes of some items; `of` returns the bounds for an axis and an item. With `is_shared` the coordinates
    /// are computed in parallel.
    pub(super) fn bound(&mut self, items: Range<usize>, is_shared: bool, of: impl Fn(usize, usize) -> [f32; 2] + Sync) {
        let fill = |(axis, (low, high)): (usize, (&mut Vec<f32>, &mut Vec<f32>))| {
            // Groups of lanes may extend beyond the last item.
            let count = low.len().max(items.end + MAX_LANES);
            low.resize(count, 0.0);
            high.resize(count, 0.0);
            let [low, high] = [&mut low[items.clone()], &mut high[items.clone()]];
            for (item, (low, high)) in items.clone().zip(low.iter_mut().zip(high)) {
                [*low, *high] = of(axis, item);
            }
        };
        if is_shared {
            self.low.par_iter_mut().zip(&mut self.high).enumerate().for_each(fill);
        } else {
            self.low.iter_mut().zip(&mut self.high).enumerate().for_each(fill);
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
