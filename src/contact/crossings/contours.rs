//! The contours along which surfaces cross: polylines whose vertices are the crossings of edges with triangles.

use std::collections::VecDeque;

/// The crossings (an edge and a triangle each) of each contour by index, each with the side of the contour on which its
/// edge is, 1 or -1. Two crossings are consecutive on a contour if the same two triangles meet at both; `beside` has the
/// triangles at an edge.
pub(crate) fn contours<'a>(found: &[[u32; 2]], beside: impl Fn(u32) -> &'a [u32]) -> Vec<Vec<(usize, f32)>> {
    // Pairs of triangles, the lower index first; the crossing; and whether the edge's triangle is the lower one.
    let mut meetings: Vec<([u32; 2], usize, f32)> = Vec::new();
    for (crossing, &[edge, triangle]) in found.iter().enumerate() {
        for &beside in beside(edge) {
            let pair = [beside.min(triangle), beside.max(triangle)];
            meetings.push((pair, crossing, if beside < triangle { 1.0 } else { -1.0 }));
        }
    }
    meetings.sort_unstable_by_key(|&(pair, crossing, _)| (pair, crossing));
    let mut next: Vec<Vec<(usize, f32)>> = vec![Vec::new(); found.len()];
    for meeting in meetings.chunk_by(|a, b| a.0 == b.0) {
        for pair in meeting.windows(2) {
            let (a, b, same) = (pair[0].1, pair[1].1, pair[0].2 * pair[1].2);
            next[a].push((b, same));
            next[b].push((a, same));
        }
    }
    let mut seen = vec![false; found.len()];
    let mut all = Vec::new();
    for first in 0..found.len() {
        if seen[first] {
            continue;
        }
        seen[first] = true;
        let (mut contour, mut queue) = (Vec::new(), VecDeque::from([(first, 1.0)]));
        while let Some((crossing, sign)) = queue.pop_front() {
            contour.push((crossing, sign));
            for &(other, same) in &next[crossing] {
                if !std::mem::replace(&mut seen[other], true) {
                    queue.push_back((other, sign * same));
                }
            }
        }
        all.push(contour);
    }
    all
}
