//! Items in ranges, one for each thread. Where data that touches several items is sorted by items, a thread does so for a
//! range, and sees the data in order. So the result does not depend on the number of ranges.

use super::workers::Workers;

/// Digits of the inverse of a length: so many that the quotient is exact while an item times the length is below `1 << DIGITS`, and that
/// the product of an item and the inverse fits.
const DIGITS: u32 = 56;

/// Consecutive items in ranges of the same length.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Ranges {
    pub count: usize,
    length: usize,
    /// The inverse of the length, by which items are divided; 0 if there is one range.
    inverse: u64,
}

impl Ranges {
    /// Divides so many items among the threads, in multiples of `grain`.
    pub(super) fn of(items: usize, grain: usize, workers: Workers<'_>) -> Ranges {
        let length = workers.part(items, grain);
        let count = items.div_ceil(length);
        Ranges { count, length, inverse: if count > 1 { (1 << DIGITS) / length as u64 + 1 } else { 0 } }
    }

    /// Number of items in a range; the last may have fewer.
    pub(super) fn len(self) -> usize {
        self.length
    }

    /// The range of an item, and its place there.
    #[inline]
    pub(super) fn place(self, item: u32) -> (usize, usize) {
        let range = ((u64::from(item) * self.inverse) >> DIGITS) as usize;
        (range, item as usize - range * self.length)
    }

    /// The range of an item as a set of ranges.
    #[inline]
    pub(super) fn bit(self, item: u32) -> u64 {
        1 << self.place(item).0
    }
}

#[cfg(test)]
#[path = "../../tests/unit/contact_ranges.rs"]
mod tests;
