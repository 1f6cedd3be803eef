//! The lists of pairs, in rows, with their multipliers.

use std::ops::Range;

use glam::Vec4;

use crate::contact::ranges::Ranges;
use crate::contact::surface::pairs::Listed;
use crate::contact::workers::Workers;
#[cfg(feature = "gpu")]
use crate::model::csr::Csr;

/// The pairs of one kind, in a row for each first feature, with their multipliers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows {
    /// The start of each row, and the end of the last. Pairs that were added later follow.
    pub starts: Vec<u32>,
    /// The first features of the pairs that were added later.
    pub later: Vec<u32>,
    pub pairs: Vec<Listed>,
    /// Multipliers (kg m): xyz for friction, w along the normal.
    pub lambda: Vec<Vec4>,
}

/// The pairs that a task of detection found, each with its row, and the ranges of rows that they are in.
#[derive(Debug, Default)]
pub(crate) struct FoundPairs {
    pub pairs: Vec<(u32, Listed)>,
    pub ranges: u64,
}

impl FoundPairs {
    /// The pairs in the rows of a range, in order.
    fn within(&self, ranges: Ranges, range: usize) -> impl Iterator<Item = &(u32, Listed)> {
        let pairs = if self.ranges >> range & 1 == 0 { &[] } else { &*self.pairs };
        pairs.iter().filter(move |(row, _)| ranges.place(*row).0 == range)
    }
}

impl Rows {
    /// Becomes another list, in its own buffers.
    pub(crate) fn copy_from(&mut self, other: &Rows) {
        self.starts.clone_from(&other.starts);
        self.later.clone_from(&other.later);
        self.pairs.clone_from(&other.pairs);
        self.lambda.clone_from(&other.lambda);
    }

    /// The corners of pairs that press, each as often as it occurs.
    pub(crate) fn pressed(&self) -> impl Iterator<Item = u32> {
        let presses = self.pairs.iter().zip(&self.lambda).filter(|(_, lambda)| lambda.w != 0.0);
        presses.flat_map(|(pair, _)| pair.corners)
    }

    /// Removes all pairs.
    pub(crate) fn clear(&mut self) {
        self.starts.clear();
        self.later.clear();
        self.pairs.clear();
        self.lambda.clear();
    }

    /// Replaces the pairs by those that tasks found, in order, with the multipliers of pairs that were listed before.
    pub(crate) fn fill<'a, I: Iterator<Item = &'a FoundPairs>>(
        &mut self,
        rows: usize,
        ranges: Ranges,
        found: impl Fn() -> I + Sync,
        before: &mut Rows,
        workers: Workers<'_>,
    ) {
        std::mem::swap(self, before);
        let Rows { starts, later, pairs, lambda } = self;
        later.clear();
        starts.clear();
        starts.resize(rows + 1, 0);
        workers.each(starts[1..].chunks_mut(ranges.len()).enumerate(), |(range, counts)| {
            let pairs = found().flat_map(|found| found.within(ranges, range));
            pairs.for_each(|(row, _)| counts[ranges.place(*row).1] += 1);
        });
        let mut total = 0;
        for start in starts.iter_mut() {
            // For now each entry is the end of the row before it, that is, the start of its own row.
            total += std::mem::replace(start, total);
        }
        pairs.resize(total as usize, Listed { corners: [0; 4], other: 0, thickness: 0.0 });
        lambda.resize(total as usize, Vec4::ZERO);
        let before = (before.starts.len() == starts.len()).then_some(&*before);
        let filling = Filling { ranges, found, before };
        let (mut pairs, mut lambda) = (&mut pairs[..], &mut lambda[..]);
        let mut starts = starts[1..].chunks_mut(ranges.len()).peekable();
        let parts = std::iter::from_fn(|| {
            let of_range = starts.next()?;
            let first = of_range[0];
            let count = (starts.peek().map_or(total, |next| next[0]) - first) as usize;
            let (pairs, lambda) = (pairs.split_off_mut(..count)?, lambda.split_off_mut(..count)?);
            Some(Part { first, starts: of_range, pairs, lambda })
        });
        workers.each(parts.enumerate(), |(range, part)| filling.fill(range, part));
        for (row, pair, multiplier) in before.into_iter().flat_map(Rows::later) {
            if let Some(place) = self.row(row).find(|&place| self.pairs[place].other == pair.other) {
                self.lambda[place] = multiplier;
            }
        }
    }

    /// Adds the pairs among these that are not listed yet; `later` is a buffer.
    pub(crate) fn append<'a>(&mut self, found: impl Iterator<Item = &'a (u32, Listed)>, later: &mut Vec<[u32; 2]>) {
        later.clear();
        later.extend(self.later().map(|(row, pair, _)| [row, pair.other]));
        later.sort_unstable();
        for &(row, pair) in found {
            let is_listed = self.row(row).any(|place| self.pairs[place].other == pair.other);
            if !is_listed && later.binary_search(&[row, pair.other]).is_err() {
                self.later.push(row);
                self.pairs.push(pair);
                self.lambda.push(Vec4::ZERO);
            }
        }
    }

    /// The same pairs, all of them in rows.
    #[cfg(feature = "gpu")]
    pub(crate) fn in_rows(self) -> Rows {
        if self.later.is_empty() {
            return self;
        }
        let places = Csr::new(self.starts.len() - 1, self.row_of_each().zip(0_u32..));
        let in_order = places.items.iter().map(|&place| (self.pairs[place as usize], self.lambda[place as usize]));
        let (pairs, lambda) = in_order.unzip();
        Rows { starts: places.starts(), later: Vec::new(), pairs, lambda }
    }

    /// The row of each pair.
    pub(crate) fn row_of_each(&self) -> impl Iterator<Item = u32> + Clone {
        let in_rows = (0..).zip(self.starts.windows(2)).flat_map(|(row, span)| (span[0]..span[1]).map(move |_| row));
        in_rows.chain(self.later.iter().copied())
    }

    /// The places of the pairs of a row, without those that were added later.
    fn row(&self, row: u32) -> Range<usize> {
        self.starts[row as usize] as usize..self.starts[row as usize + 1] as usize
    }

    /// The pairs that were added later: their rows, and their multipliers.
    pub(crate) fn later(&self) -> impl Iterator<Item = (u32, &Listed, Vec4)> {
        let first = self.pairs.len() - self.later.len();
        let pairs = self.pairs[first..].iter().zip(&self.lambda[first..]);
        self.later.iter().zip(pairs).map(|(&row, (pair, &multiplier))| (row, pair, multiplier))
    }
}

/// The rows of a range.
struct Part<'a> {
    /// Number of pairs in the rows before.
    first: u32,
    /// The start of each row; when it is filled, its end.
    starts: &'a mut [u32],
    pairs: &'a mut [Listed],
    lambda: &'a mut [Vec4],
}

struct Filling<'a, F> {
    ranges: Ranges,
    found: F,
    /// The pairs that were listed before, if there are any.
    before: Option<&'a Rows>,
}

impl<'a, I: Iterator<Item = &'a FoundPairs>, F: Fn() -> I + Sync> Filling<'_, F> {
    /// Fills a range.
    fn fill(&self, range: usize, part: Part<'_>) {
        let Part { first, starts, pairs, lambda } = part;
        for &(row, pair) in (self.found)().flat_map(|found| found.within(self.ranges, range)) {
            let place = &mut starts[self.ranges.place(row).1];
            pairs[(*place - first) as usize] = pair;
            *place += 1;
        }
        lambda.fill(Vec4::ZERO);
        let Some(before) = self.before else { return };
        let mut start = 0;
        for (row, &end) in (range * self.ranges.len()..).zip(&*starts) {
            let row_of = |starts: &[u32]| starts[row] as usize..starts[row + 1] as usize;
            let end = (end - first) as usize;
            for index in row_of(&before.starts).filter(|&index| before.lambda[index] != Vec4::ZERO) {
                let other = before.pairs[index].other;
                let same = (start..end).find(|&place| pairs[place].other == other);
                same.into_iter().for_each(|place| lambda[place] = before.lambda[index]);
            }
            start = end;
        }
    }
}
