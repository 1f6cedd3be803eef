//! How far a cloth spans between what holds it, which bounds how much of it hangs on an edge.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DVec3, Vec3};

use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::link::Link;
use crate::model::mesh::bounds;

/// See [`extents`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extents {
    /// The longest sides (m) of the bounding boxes of the connected parts along each axis, none above `extent`.
    pub sides: DVec3,
    /// How far (m) any part spans: twice the longest way along edges to the nearest pin, or across its bounding box if that
    /// is less.
    pub extent: f64,
    /// The longest distance (m) along edges from a pin that a hundredth of a part's vertices does not exceed; 0 without pins.
    pub near: f64,
    /// Number of connected parts.
    pub parts: usize,
}

/// The extents of a cloth, part by part: cloths that share a mesh stretch as each alone would, and a curtain on many
/// hooks as much as a narrow one.
pub(crate) fn extents(rest: &[Vec3], links: &[Link], is_pinned: impl Fn(u32) -> bool) -> Extents {
    let vertices = rest.len() as u32;
    let part = DisjointSets::parts_of_links(rest.len(), links);
    let pins: Vec<u32> = (0..vertices).filter(|&vertex| is_pinned(vertex)).collect();
    let distance = if pins.is_empty() { Vec::new() } else { distances(rest.len(), links, &pins) };
    let by_part = Csr::new(rest.len(), part.iter().copied().zip(0..vertices));
    let extents = by_part.lists().map(|vertices| {
        let [low, high] = bounds(vertices.iter().map(|&vertex| rest[vertex as usize]));
        let sides = (high.as_dvec3() - low.as_dvec3()).max(DVec3::ZERO);
        let farthest = vertices.iter().filter_map(|&vertex| distance.get(vertex as usize)).fold(0.0, |a: f64, &b| a.max(b));
        let near = nearest_hundredth(vertices.iter().filter_map(|&vertex| distance.get(vertex as usize)).copied().collect());
        let across = sides.max_element();
        // Cloth that is held on two sides hangs from both. A part without pins has infinite distances, if any.
        let extent = if distance.is_empty() { across } else { across.min(2.0 * farthest) };
        Extents { sides: sides.min(DVec3::splat(extent)), extent, near, parts: usize::from(!vertices.is_empty()) }
    });
    let none = Extents { sides: DVec3::ZERO, extent: 0.0, near: 0.0, parts: 0 };
    extents.fold(none, |a, b| Extents {
        sides: a.sides.max(b.sides),
        extent: a.extent.max(b.extent),
        near: a.near.max(b.near),
        parts: a.parts + b.parts,
    })
}

/// The distance that a hundredth of some does not exceed; 0 without any, or if it is infinite.
fn nearest_hundredth(mut distance: Vec<f64>) -> f64 {
    if distance.is_empty() {
        return 0.0;
    }
    let hundredth = distance.len() / 100;
    let near = *distance.select_nth_unstable_by(hundredth, f64::total_cmp).1;
    if near.is_finite() { near } else { 0.0 }
}

/// The length (m) of the shortest way along edges from each vertex to a pin (Dijkstra 1959); infinite if there is none.
fn distances(vertices: usize, links: &[Link], pins: &[u32]) -> Vec<f64> {
    let ways = links.iter().flat_map(|link| {
        let [a, b] = link.ends;
        [(a, (b, link.rest)), (b, (a, link.rest))]
    });
    let ways = Csr::new(vertices, ways);
    let mut distance = vec![f64::INFINITY; vertices];
    pins.iter().for_each(|&pin| distance[pin as usize] = 0.0);
    // The bits of positive numbers are in the order of the numbers.
    let mut next: BinaryHeap<Reverse<(u64, u32)>> = pins.iter().map(|&pin| Reverse((0, pin))).collect();
    while let Some(Reverse((bits, vertex))) = next.pop() {
        let here = f64::from_bits(bits);
        if here > distance[vertex as usize] {
            continue;
        }
        for &(other, length) in ways.of(vertex) {
            let there = here + f64::from(length);
            if there < distance[other as usize] {
                distance[other as usize] = there;
                next.push(Reverse((there.to_bits(), other)));
            }
        }
    }
    distance
}

#[cfg(test)]
#[path = "../../tests/unit/model_extents.rs"]
mod tests;
