//! Items in ranges, one or two for each thread. Where data that touches several items is sorted by items, a task does so
//! for a range, and sees the data in order. So the result does not depend on the number of ranges.

/// Most ranges: one for each bit of a set of ranges.
const MOST: usize = 64;

/// Consecutive items in ranges of a power of two.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Ranges {
    pub count: usize,
    shift: u32,
}

impl Ranges {
    /// Divides so many items among the threads, or not at all.
    pub(super) fn of(items: usize, is_shared: bool) -> Ranges {
        let most = if is_shared { MOST.min(2 * rayon::current_num_threads()) } else { 1 };
        let shift = items.div_ceil(most).next_power_of_two().trailing_zeros();
        Ranges { count: items.div_ceil(1 << shift), shift }
    }

    /// Number of items in a range; the last may have fewer.
    pub(super) fn len(self) -> usize {
        1 << self.shift
    }

    /// The range of an item, and its place there.
    #[inline]
    pub(super) fn place(self, item: u32) -> (usize, usize) {
        ((item >> self.shift) as usize, item as usize & (self.len() - 1))
    }

    /// The range of an item as a set of ranges.
    #[inline]
    pub(super) fn bit(self, item: u32) -> u64 {
        1 << (item >> self.shift)
    }
}
