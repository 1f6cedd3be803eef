//! How to shorten the contours along which surfaces cross.

use glam::Vec3A;

use super::Tangle;
use crate::contact::crossings::contours::contours;

/// Smallest cosine between an edge and the normal of the triangle that it crosses; a flatter crossing would require an
/// arbitrarily large distance.
const FLATTEST: f32 = 0.1;

/// For each crossing the direction in which its edge is to move, and its triangle in the opposite direction; at most of
/// length 1.
///
/// Each is the sum of its own gradient and of the mean over its contour, because its own gradient alone does not move
/// the straight parts of a contour.
pub(crate) fn gradients(tangle: &Tangle<'_>, found: &[[u32; 2]]) -> Vec<Vec3A> {
    let own: Vec<Vec3A> = found.iter().map(|&crossing| gradient(tangle, crossing)).collect();
    let mut all = own.clone();
    for contour in contours(found, |edge| tangle.at_edges.of(edge)) {
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
fn gradient(tangle: &Tangle<'_>, [edge, triangle]: [u32; 2]) -> Vec3A {
    let [p, q] = tangle.edges[edge as usize].map(|vertex| tangle.at(vertex));
    let (e, n) = ((q - p).normalize_or_zero(), tangle.normal(triangle));
    let across = e.dot(n);
    let across = across.abs().max(FLATTEST).copysign(across);
    let through = |&beside: &u32| {
        let middle: Vec3A = tangle.triangles[beside as usize].into_iter().map(|vertex| tangle.at(vertex)).sum::<Vec3A>() / 3.0;
        let inward = (middle - p).reject_from_normalized(e);
        let along = n.cross(tangle.normal(beside)).normalize_or_zero();
        let r = along * 1.0_f32.copysign(along.dot(inward));
        r - n * (e.dot(r) / across)
    };
    tangle.at_edges.of(edge).iter().map(through).sum()
}
