//! The cloth's triangles without caps: triangles without area whose one corner lies on the opposite side (Botsch and Kobbelt
//! 2001, "A robust procedure to eliminate degenerate faces from triangle meshes"). They fill T-junctions.
//!
//! That corner touches the triangle beyond the side, although the two share no corner, and the vector between them is
//! nothing but rounding errors. Held apart along it, cloth would not move. So the cap is left out, and what else is at its side
//! is split at its corner, which changes no shape.

use glam::Vec4;

use crate::model::csr::distinct;

/// At most this many times as many splits as triangles are made. More arise only in meshes where hundreds of triangles share sides.
const MOST_SPLITS: usize = 4;
/// Most corners of caps on the same side that are considered.
const MOST_ON_SIDE: usize = 16;

/// The triangles without those that are lower than `least` (m), in a mesh whose positions at rest (m) are given. If that would take
/// too many splits, all of them.
pub(super) fn without_caps(triangles: &[[u32; 3]], rest: &[Vec4], least: f64) -> Vec<[u32; 3]> {
    let caps = triangles.iter().filter_map(|&triangle| cap(triangle, rest, least));
    let caps: Vec<[u32; 3]> = distinct(caps.collect());
    if caps.is_empty() {
        return triangles.to_vec();
    }
    // Any two of the points on a side, and the point after the first.
    let mut splits: Vec<[u32; 3]> = Vec::new();
    for on_side in caps.chunk_by(|one, other| one[..2] == other[..2]) {
        let [a, b, _] = on_side[0];
        // Distances are not negative, so they are in the order of their bits.
        let from_a = |corner: u32| rest[corner as usize].truncate().distance(rest[a as usize].truncate()).to_bits();
        let mut corners: Vec<[u32; 2]> = on_side.iter().map(|&[_, _, corner]| [from_a(corner), corner]).collect();
        corners.sort_unstable();
        corners.truncate(MOST_ON_SIDE);
        let points: Vec<u32> = [a].into_iter().chain(corners.into_iter().map(|[_, corner]| corner)).chain([b]).collect();
        for (index, &from) in points.iter().enumerate() {
            let beyond = points.iter().skip(index + 2);
            splits.extend(beyond.map(|&to| [from.min(to), from.max(to), points[index + 1]]));
        }
    }
    splits.sort_unstable();
    let (mut kept, mut count) = (Vec::new(), 0);
    let mut left: Vec<[u32; 3]> = triangles.iter().copied().filter(|&triangle| cap(triangle, rest, least).is_none()).collect();
    while let Some([a, b, c]) = left.pop() {
        let split = [[a, b, c], [b, c, a], [c, a, b]].into_iter().find_map(|[a, b, c]| {
            let side = [a.min(b), a.max(b)];
            let &[.., corner] =
                splits.get(splits.partition_point(|split| split[..2] < side[..])).filter(|split| split[..2] == side)?;
            (corner != c).then_some([[a, corner, c], [corner, b, c]])
        });
        match split {
            Some(_) if count >= MOST_SPLITS * triangles.len() => return triangles.to_vec(),
            Some(halves) => {
                left.extend(halves);
                count += 1;
            }
            None => kept.push([a, b, c]),
        }
    }
    kept
}

/// The ends of a triangle's longest side, if it is a cap, and the corner that lies on it.
fn cap([a, b, c]: [u32; 3], rest: &[Vec4], least: f64) -> Option<[u32; 3]> {
    let at = |vertex: u32| rest[vertex as usize].truncate().as_dvec3();
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().find_map(|[a, b, c]| {
        let (to_a, to_b) = (at(a) - at(c), at(b) - at(c));
        let height = to_a.cross(to_b).length() / (to_b - to_a).length();
        let is_between = to_a.dot(to_b) < 0.0 && to_a.length().min(to_b.length()) > least;
        (is_between && height <= least).then_some([a.min(b), a.max(b), c])
    })
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_caps.rs"]
mod tests;
