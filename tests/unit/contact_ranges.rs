//! Items are divided among threads.

use super::super::workers::MAX_PARTS;
use super::*;

/// The ends of all ranges are in the range, and at the place, that division gives, also in the largest meshes.
#[test]
fn ranges_end_where_division_says() {
    for items in [1, 63, 4096, 1_484_718, 3_141_633, 12_574_721, 100_000_007] {
        for threads in 1..=MAX_PARTS {
            let ranges = Ranges::of(items, 1, Workers::new(threads, &|_, _| ()));
            for range in 0..ranges.count {
                let first = range * ranges.len();
                for item in [first, (first + ranges.len()).min(items) - 1] {
                    let expected = (item / ranges.len(), item % ranges.len());
                    assert_eq!(ranges.place(item as u32), expected, "item {item} of {items} on {threads} threads");
                }
            }
        }
    }
}
