//! Pairs of features: a vertex and a triangle, or two edges.

use super::Surface;
use crate::kernels::pair::{Kind, sum_of_sides};
use crate::simd::Lanes;

/// Sides that come closer than this (m), by what they are about to move, may meet in this substep: their thickness or, where that is
/// less, how much farther contact may move them, by the [`allowance`](Surface::allowance) (m) of the corners.
#[inline(always)]
pub(crate) fn reach<L: Lanes>(kind: Kind, thickness: L, allowance: [L; 4]) -> L {
    thickness.max(sum_of_sides(kind, allowance))
}

/// A listed pair.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Listed {
    pub corners: [u32; 4],
    /// The second feature; the first is the row of the list.
    pub other: u32,
    /// Distance (m) at which they are held apart.
    pub thickness: f32,
}

/// The corners of a pair.
pub(crate) fn corners(surface: &Surface, kind: Kind, [first, second]: [u32; 2]) -> [u32; 4] {
    match kind {
        Kind::VertexTriangle => {
            let [a, b, c] = surface.triangles[second as usize];
            [first, a, b, c]
        }
        Kind::EdgeEdge => {
            let ([a, b], [c, d]) = (surface.edges[first as usize], surface.edges[second as usize]);
            [a, b, c, d]
        }
    }
}

/// An edge and a triangle that intersect once a pair with these corners has moved through each other: those of the pair, or
/// beside them.
pub(crate) fn crossing_of(surface: &Surface, kind: Kind, [a, b, c, d]: [u32; 4]) -> Option<[u32; 2]> {
    let triangle_of = |at: u32, has: &[u32]| {
        let mut triangles = surface.at.of(at).iter().copied();
        triangles.find(|&triangle| has.iter().all(|of| surface.triangles[triangle as usize].contains(of)))
    };
    let edge_of = |at: u32, has: &[u32]| {
        let mut edges = surface.at.of(at).iter().flat_map(|&triangle| surface.sides[triangle as usize]);
        edges.find(|&edge| has.iter().all(|of| surface.edges[edge as usize].contains(of)))
    };
    Some(match kind {
        Kind::VertexTriangle => [edge_of(a, &[a])?, triangle_of(b, &[b, c, d])?],
        Kind::EdgeEdge => [edge_of(a, &[a, b])?, triangle_of(c, &[c, d])?],
    })
}
