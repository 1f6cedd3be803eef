//! Pairs of overlapping boxes, by cells that are halved until they hold few.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;

use crate::HAS_THREADS;

/// The lowest and the highest corner (m).
pub(crate) type Span = [DVec3; 2];

const NOTHING: Span = [DVec3::INFINITY, DVec3::NEG_INFINITY];
/// A cell is not divided if it has no more pairs of a box of either list.
const FEW: u64 = 256;
/// Nor if its halves would have more than this share of those pairs, because its boxes overlap one another.
const WORTH: f64 = 0.9;
/// More of these pairs are worth several threads.
const MANY: u64 = 1 << 18;

/// The box around some points, enlarged by `by` (m).
pub(crate) fn box_around(points: &[DVec3], by: f64) -> Span {
    let [low, high] = points.iter().fold(NOTHING, |[low, high], &x| [low.min(x), high.max(x)]);
    [low - by, high + by]
}

/// Whether two boxes overlap.
pub(crate) fn overlap(a: &Span, b: &Span) -> bool {
    a[0].cmple(b[1]).all() && a[1].cmpge(b[0]).all()
}

/// The pairs of a box of one list and a box of the other that overlap and pass a `test`, as indices in no particular order. Ends when
/// `room` for overlapping pairs is used up; it is 0 then, and what is returned has no meaning. If it `is_shared`, the pool's threads
/// help; while this one waits for them, it may do other work of the pool.
pub(crate) fn overlaps(
    one: &[Span],
    other: &[Span],
    room: &mut usize,
    is_shared: bool,
    test: &(dyn Fn(usize, usize) -> bool + Sync),
) -> Vec<[u32; 2]> {
    let all = [one, other].map(|boxes| (0..boxes.len() as u32).collect());
    let most_alone = if is_shared { MANY } else { u64::MAX };
    let search = Search { boxes: [one, other], room: *room, used: AtomicUsize::new(0), most_alone, test };
    let found = search.within(&all, [DVec3::NEG_INFINITY, DVec3::INFINITY]);
    *room = room.saturating_sub(search.used.into_inner());
    found
}

struct Search<'a> {
    boxes: [&'a [Span]; 2],
    room: usize,
    used: AtomicUsize,
    /// More pairs are divided among threads.
    most_alone: u64,
    test: &'a (dyn Fn(usize, usize) -> bool + Sync),
}

impl Search<'_> {
    /// Searches among the boxes of both lists that reach into a cell. A cell includes its lower borders only.
    fn within(&self, both: &[Vec<u32>; 2], cell: Span) -> Vec<[u32; 2]> {
        let count = |both: &[Vec<u32>; 2]| both[0].len() as u64 * both[1].len() as u64;
        if count(both) > FEW {
            let (axis, middle) = self.cut(both, cell);
            let halves = [0, 1].map(|half| self.half(both, axis, middle, half));
            let is_worth = halves.iter().map(count).sum::<u64>() as f64 <= WORTH * count(both) as f64;
            if is_worth {
                let [mut low, mut high] = [cell, cell];
                (low[1][axis], high[0][axis]) = (middle, middle);
                let [below, above] = [(&halves[0], low), (&halves[1], high)].map(|(half, cell)| move || self.within(half, cell));
                return self.together(count(both), below, above);
            }
        }
        let [one, other] = both;
        self.compare(one, other, cell)
    }

    /// Compares each box of one list with each of the other.
    fn compare(&self, ones: &[u32], others: &[u32], cell: Span) -> Vec<[u32; 2]> {
        let count = ones.len() as u64 * others.len() as u64;
        if count > self.most_alone && ones.len() > 1 {
            let (first, last) = ones.split_at(ones.len() / 2);
            return self.together(count, || self.compare(first, others, cell), || self.compare(last, others, cell));
        }
        let mut found = Vec::new();
        for &a in ones {
            let mut used = 0;
            for &b in others {
                let (one, other) = (&self.boxes[0][a as usize], &self.boxes[1][b as usize]);
                // Two boxes may be in several cells together. They meet in that of the lowest corner of what they share.
                let corner = one[0].max(other[0]);
                if overlap(one, other) && corner.cmpge(cell[0]).all() && corner.cmplt(cell[1]).all() {
                    used += 1;
                    if (self.test)(a as usize, b as usize) {
                        found.push([a, b]);
                    }
                }
            }
            if used > 0 && self.used.fetch_add(used, Ordering::Relaxed) + used >= self.room {
                break;
            }
        }
        found
    }

    /// What two searches find among so many pairs.
    fn together(
        &self,
        count: u64,
        one: impl FnOnce() -> Vec<[u32; 2]> + Send,
        other: impl FnOnce() -> Vec<[u32; 2]> + Send,
    ) -> Vec<[u32; 2]> {
        let (mut found, more) = if HAS_THREADS && count > self.most_alone { rayon::join(one, other) } else { (one(), other()) };
        found.extend(more);
        found
    }

    /// The axis along which the lowest corners of the boxes extend the farthest within the cell, and their mean on it.
    fn cut(&self, both: &[Vec<u32>; 2], cell: Span) -> (usize, f64) {
        let (mut sum, mut count, [mut low, mut high]) = (DVec3::ZERO, 0.0, NOTHING);
        for (boxes, indices) in self.boxes.iter().zip(both) {
            for &index in indices {
                let corner = boxes[index as usize][0].max(cell[0]);
                (sum, count, low, high) = (sum + corner, count + 1.0, low.min(corner), high.max(corner));
            }
        }
        let axis = (high - low).max_position();
        (axis, sum[axis] / count)
    }

    /// The boxes that reach below `middle` on an axis, or those that reach up to it.
    fn half(&self, both: &[Vec<u32>; 2], axis: usize, middle: f64, half: usize) -> [Vec<u32>; 2] {
        [0, 1].map(|list| {
            let reaches = |index: &u32| {
                let [low, high] = self.boxes[list][*index as usize];
                if half == 0 { low[axis] < middle } else { high[axis] >= middle }
            };
            both[list].iter().copied().filter(reaches).collect()
        })
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_overlaps.rs"]
mod tests;
