//! The contours along which surfaces cross, and how to shorten them.

use std::collections::VecDeque;

use glam::Vec3A;

use super::Tangle;

/// Smallest cosine between an edge and the normal of the triangle that it crosses; a flatter crossing would require an
/// arbitrarily large distance.
const FLATTEST: f32 = 0.1;

/// For each crossing the direction in which its edge is to move, and its triangle in the opposite direction; at most of
/// length 1.
///
/// Each is the sum of its own gradient and of the mean over its contour, because its own gradient alone does not move
/// the straight parts of a contour.
pub(super) fn gradients(tangle: &Tangle, found: &[[u32; 2]]) -> Vec<Vec3A> {
    let own: Vec<Vec3A> = found.iter().map(|&crossing| gradient(tangle, crossing)).collect();
    let mut all = own.clone();
    for contour in contours(tangle, found) {
        let mean = contour.iter().map(|&(crossing, sign)| own[crossing] * sign).sum::<Vec3A>() / contour.len() as f32;
        contour.iter().for_each(|&(crossing, sign)| all[crossing] += mean * sign);
    }
    // A small sum is not normalized, because the last crossings would oscillate otherwise.
    all.iter().map(|&gradient| gradient / (gradient.length_squared() + 0.01).sqrt()).collect()
}

/// The direction in which the edge of a crossing has to move to shorten the contour fastest.
///
/// If the edge's side moves by `d`, the point where its direction `E` meets the triangle's plane with normal `N` moves
/// in that plane by `d - E (N.d)/(E.N)`. From there the contour continues along `R` through each of the triangles at
/// the edge, so that it becomes shorter by `R.d - (E.R)(N.d)/(E.N)`.
fn gradient(tangle: &Tangle, [edge, triangle]: [u32; 2]) -> Vec3A {
    let [p, q] = tangle.edges[edge as usize].map(|vertex| tangle.at(vertex));
    let normal = |triangle: u32| {
        let [a, b, c] = tangle.triangles[triangle as usize].map(|vertex| tangle.at(vertex));
        (b - a).cross(c - a).normalize_or_zero()
    };
    let (e, n) = ((q - p).normalize_or_zero(), normal(triangle));
    let across = e.dot(n);
    let across = across.abs().max(FLATTEST).copysign(across);
    let through = |&beside: &u32| {
        let middle: Vec3A = tangle.triangles[beside as usize].into_iter().map(|vertex| tangle.at(vertex)).sum::<Vec3A>() / 3.0;
        let inward = (middle - p).reject_from_normalized(e);
        let along = n.cross(normal(beside)).normalize_or_zero();
        let r = along * 1.0_f32.copysign(along.dot(inward));
        r - n * (e.dot(r) / across)
    };
    tangle.at_edges.of(edge).iter().map(through).sum()
}

/// The crossings of each contour, each with the side of the contour on which its edge is, 1 or -1. Two crossings are
/// consecutive on a contour if the same two triangles meet at both.
fn contours(tangle: &Tangle, found: &[[u32; 2]]) -> Vec<Vec<(usize, f32)>> {
    // Pairs of triangles, the lower index first; the crossing; and whether the edge's triangle is the lower one.
    let mut meetings: Vec<([u32; 2], usize, f32)> = Vec::new();
    for (crossing, &[edge, triangle]) in found.iter().enumerate() {
        for &beside in tangle.at_edges.of(edge) {
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
