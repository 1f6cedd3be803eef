//! Bounding boxes of features, stored by coordinate, so that one box is compared with as many others as there are SIMD
//! lanes.

use std::ops::Range;

use glam::Vec3A;

use crate::contact::workers::Workers;
use crate::simd::{MAX_LANES, Registers};

/// Least number of boxes that are worth a part of a loop.
const GRAIN: usize = 64;

/// Lower and upper bounds (m) per coordinate of many boxes.
#[derive(Debug, Default)]
pub(crate) struct Boxes {
    low: [Vec<f32>; 3],
    high: [Vec<f32>; 3],
}

impl Boxes {
    /// Sets the boxes of some items; `of` returns that of an item.
    pub(crate) fn bound(&mut self, items: Range<usize>, workers: Workers<'_>, of: impl Fn(usize) -> [Vec3A; 2] + Sync) {
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

    /// The lower and the upper bounds of a box.
    #[inline(always)]
    pub(crate) fn bounds(&self, item: usize) -> [[f32; 3]; 2] {
        let (low, high) = (&self.low, &self.high);
        [[low[0][item], low[1][item], low[2][item]], [high[0][item], high[1][item], high[2][item]]]
    }

    /// The boxes from `first` on, at most `count` and at most one per lane, enlarged by `by`. Only those count that then
    /// touch `place`.
    #[inline(always)]
    pub(crate) fn in_lanes<L: Registers>(&self, first: usize, count: usize, place: [Vec3A; 2], by: Vec3A) -> BoxLanes<L> {
        let lanes = first..first + L::LANES;
        let by = [L::splat(by.x), L::splat(by.y), L::splat(by.z)];
        let mut boxes = BoxLanes { low: by, high: by, lanes: (1_u32 << count.min(L::LANES)) - 1 };
        for (axis, by) in by.into_iter().enumerate() {
            boxes.low[axis] = L::from_slice(&self.low[axis][lanes.clone()]) - by;
            boxes.high[axis] = L::from_slice(&self.high[axis][lanes.clone()]) + by;
        }
        boxes.lanes = boxes.touching([place[0].to_array(), place[1].to_array()]);
        boxes
    }
}

/// Boxes in lanes, to be compared with many others.
pub(crate) struct BoxLanes<L> {
    low: [L; 3],
    high: [L; 3],
    /// Those that count, one bit each.
    pub lanes: u32,
}

impl<L: Registers> BoxLanes<L> {
    /// Which of them touch a box, as one bit each.
    #[inline(always)]
    pub(crate) fn touching(&self, [low, high]: [[f32; 3]; 2]) -> u32 {
        let x = L::and(self.low[0].lt(L::splat(high[0])), L::splat(low[0]).lt(self.high[0]));
        let y = L::and(self.low[1].lt(L::splat(high[1])), L::splat(low[1]).lt(self.high[1]));
        let z = L::and(self.low[2].lt(L::splat(high[2])), L::splat(low[2]).lt(self.high[2]));
        L::bits(L::and(x, L::and(y, z))) & self.lanes
    }
}
