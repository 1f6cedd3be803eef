//! Pairs of overlapping boxes, by sweep and prune along the longest axis.

use glam::DVec3;

/// The lowest and the highest corner (m).
pub(super) type Span = [DVec3; 2];

const NOTHING: Span = [DVec3::INFINITY, DVec3::NEG_INFINITY];

/// The box around some points, enlarged by `by` (m).
pub(super) fn around(points: &[DVec3], by: f64) -> Span {
    let [low, high] = points.iter().fold(NOTHING, |[low, high], &x| [low.min(x), high.max(x)]);
    [low - by, high + by]
}

/// Whether two boxes overlap.
pub(super) fn overlap(a: &Span, b: &Span) -> bool {
    a[0].cmple(b[1]).all() && a[1].cmpge(b[0]).all()
}

/// Calls `meet` for each pair of a box of one list and a box of the other that overlap, until `room` for such pairs is
/// used up.
pub(super) fn for_overlaps(one: &[Span], other: &[Span], room: &mut usize, mut meet: impl FnMut(usize, usize)) {
    let [low, high] = other.iter().fold(NOTHING, |[low, high], span| [low.min(span[0]), high.max(span[1])]);
    let extent = high - low;
    let axis = if extent.x >= extent.y && extent.x >= extent.z { 0 } else { 1 + usize::from(extent.z > extent.y) };
    let sorted = |spans: &[Span]| {
        let mut order: Vec<(f64, u32)> = spans.iter().map(|span| span[0][axis]).zip(0..).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order
    };
    let others = sorted(other);
    // A box of the other list is active while it begins before one ends and ends after it begins.
    let (mut active, mut next) = (Vec::<(f64, u32)>::new(), 0);
    for (from, index) in sorted(one) {
        let span = &one[index as usize];
        while next < others.len() && others[next].0 <= span[1][axis] {
            let index = others[next].1;
            active.push((other[index as usize][1][axis], index));
            next += 1;
        }
        active.retain(|(end, _)| *end >= from);
        for &(_, item) in &active {
            if overlap(span, &other[item as usize]) {
                if *room == 0 {
                    return;
                }
                *room -= 1;
                meet(index as usize, item as usize);
            }
        }
    }
}
