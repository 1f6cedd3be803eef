//! The cloth's triangles without caps: triangles without area whose one corner lies on the opposite side (Botsch and Kobbelt
//! 2001, "A robust procedure to eliminate degenerate faces from triangle meshes"). They fill T-junctions.
//!
//! That corner touches the triangle beyond the side, although the two share no corner, and the vector between them is
//! nothing but rounding errors. Held apart along it, cloth would not move. So the cap is left out, and what else is at its side
//! is split at its corner, which changes no shape.

use glam::Vec4;

/// At most this many times as many splits as triangles are made. More arise only in meshes where hundreds of triangles share sides.
const MOST_SPLITS: usize = 4;
/// Most corners of caps on the same side that are considered.
const MOST_ON_SIDE: usize = 16;

/// The triangles without those that are lower than `least` (m), in a mesh whose positions at rest (m) are given. If that would take
/// too many splits, all of them.
pub(super) fn without_caps(triangles: &[[u32; 3]], rest: &[Vec4], least: f64) -> Vec<[u32; 3]> {
    let caps = triangles.iter().filter_map(|&triangle| cap(triangle, rest, least));
    let mut caps: Vec<([u32; 2], u32)> = caps.collect();
    if caps.is_empty() {
        return triangles.to_vec();
    }
    caps.sort_unstable();
    caps.dedup();
    // Between any two of the points on a side, the one after the first.
    let mut corner_on: Vec<([u32; 2], u32)> = Vec::new();
    for on_side in caps.chunk_by(|one, other| one.0 == other.0) {
        let [a, b] = on_side[0].0;
        // Distances are not negative, so they are in the order of their bits.
        let from_a = |corner: u32| rest[corner as usize].truncate().distance(rest[a as usize].truncate()).to_bits();
        let mut corners: Vec<[u32; 2]> = on_side.iter().map(|&(_, corner)| [from_a(corner), corner]).collect();
        corners.sort_unstable();
        corners.truncate(MOST_ON_SIDE);
        let points: Vec<u32> = [a].into_iter().chain(corners.into_iter().map(|[_, corner]| corner)).chain([b]).collect();
        for (index, &from) in points.iter().enumerate() {
            let beyond = points.iter().skip(index + 2);
            corner_on.extend(beyond.map(|&to| ([from.min(to), from.max(to)], points[index + 1])));
        }
    }
    corner_on.sort_unstable();
    corner_on.dedup_by_key(|(side, _)| *side);
    let (mut kept, mut splits) = (Vec::new(), 0);
    let mut left: Vec<[u32; 3]> = triangles.iter().copied().filter(|&triangle| cap(triangle, rest, least).is_none()).collect();
    while let Some([a, b, c]) = left.pop() {
        let split = [[a, b, c], [b, c, a], [c, a, b]].into_iter().find_map(|[a, b, c]| {
            let place = corner_on.binary_search_by_key(&[a.min(b), a.max(b)], |(side, _)| *side).ok()?;
            let corner = corner_on[place].1;
            (corner != c).then_some([[a, corner, c], [corner, b, c]])
        });
        match split {
            Some(_) if splits >= MOST_SPLITS * triangles.len() => return triangles.to_vec(),
            Some(halves) => {
                left.extend(halves);
                splits += 1;
            }
            None => kept.push([a, b, c]),
        }
    }
    kept
}

/// The longest side of a triangle if it is a cap, and the corner that lies on it.
fn cap([a, b, c]: [u32; 3], rest: &[Vec4], least: f64) -> Option<([u32; 2], u32)> {
    let at = |vertex: u32| rest[vertex as usize].truncate().as_dvec3();
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().find_map(|[a, b, c]| {
        let (to_a, to_b) = (at(a) - at(c), at(b) - at(c));
        let height = to_a.cross(to_b).length() / (to_b - to_a).length();
        let is_between = to_a.dot(to_b) < 0.0 && to_a.length().min(to_b.length()) > least;
        (is_between && height <= least).then_some(([a.min(b), a.max(b)], c))
    })
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_caps.rs"]
mod tests;
