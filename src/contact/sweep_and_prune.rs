//! Pairs of overlapping boxes: strips along the longest axis, and sweep and prune in each.

use glam::DVec3;

/// The lowest and the highest corner (m).
pub(super) type Span = [DVec3; 2];

const NOTHING: Span = [DVec3::INFINITY, DVec3::NEG_INFINITY];
/// Least width of a strip, in units of the mean width of a box.
const WIDTH: f64 = 4.0;

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
    let shortest = extent.min_position();
    let [first, second] = [(shortest + 1) % 3, (shortest + 2) % 3];
    let [along, across] = if extent[first] >= extent[second] { [first, second] } else { [second, first] };
    let boxes = one.len() + other.len();
    let mean = one.iter().chain(other).map(|span| span[1][across] - span[0][across]).sum::<f64>() / boxes as f64;
    let count = (extent[across] / (WIDTH * mean)).min((boxes as f64).sqrt()).max(1.0);
    // What is beyond the strips is in the nearest one.
    let strip = |place: f64| ((place - low[across]) / extent[across] * count).clamp(0.0, count - 1.0) as usize;
    let divided = |spans: &[Span]| {
        let mut strips = vec![Vec::new(); count as usize];
        for (index, span) in (0..).zip(spans) {
            let first = strip(span[0][across]);
            let last = strip(span[1][across]).max(first);
            strips[first..=last].iter_mut().for_each(|strip| strip.push(index));
        }
        strips
    };
    for (index, strips) in divided(one).iter().zip(&divided(other)).enumerate() {
        sweep([one, other], [strips.0, strips.1], along, room, |a, b| {
            // Two boxes may be in several strips together.
            if strip(one[a][0][across].max(other[b][0][across])) == index {
                meet(a, b);
            }
        });
    }
}

/// The same for the boxes with these indices, sorted along an axis.
fn sweep(
    [one, other]: [&[Span]; 2],
    [ones, others]: [&[u32]; 2],
    axis: usize,
    room: &mut usize,
    mut meet: impl FnMut(usize, usize),
) {
    let sorted = |spans: &[Span], indices: &[u32]| {
        let mut order: Vec<(f64, u32)> = indices.iter().map(|&index| (spans[index as usize][0][axis], index)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order
    };
    let others = sorted(other, others);
    // A box of the other list is active while it begins before one ends and ends after it begins.
    let (mut active, mut next) = (Vec::<(f64, u32)>::new(), 0);
    for (from, index) in sorted(one, ones) {
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
