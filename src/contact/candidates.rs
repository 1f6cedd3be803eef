//! Candidates: pairs of features whose boxes are within reach of each other.

use std::ops::Range;

use glam::Vec3A;

use super::boxes::Boxes;
use super::surface::Surface;
use super::tree::{Look, Tree};
use crate::simd::{Loop, Registers};

/// Indices of the features' boxes.
pub(super) const TRIANGLES: usize = 0;
pub(super) const EDGES: usize = 1;
pub(super) const VERTICES: usize = 2;

/// Finds pairs of features of two leaves, or of one, whose boxes are within reach.
pub(super) struct Candidates<'a> {
    pub surface: &'a Surface,
    pub look: Look,
    pub boxes: &'a [Boxes; 3],
    pub trees: [&'a Tree; 2],
    /// Whether both trees are the same.
    pub is_own: bool,
    pub leaves: &'a [[u32; 2]],
    pub near: &'a mut [Vec<[u32; 2]>; 2],
}

impl Loop for Candidates<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Candidates { surface, look, boxes, trees: [cloth, others], is_own, leaves, near } = self;
        let [vertex_triangle, edge_edge] = near;
        for &[a, b] in leaves {
            let (one, other) = (cloth.leaf(a), others.leaf(b));
            let reach = one.reach(other, look.margin, look.substeps);
            let (of_a, of_b) = (&cloth.leaves, &others.leaves);
            let [a, b] = [a as usize, b as usize];
            let is_one = is_own && a == b;
            let (vertices, triangles) = (of_a.vertices_of(a), of_b.triangles_of(b));
            pierce::<L>(surface, boxes, [vertices, triangles], grown(other.place, reach), reach, vertex_triangle);
            if !is_one {
                let (vertices, triangles) = (of_b.vertices_of(b), of_a.triangles_of(a));
                pierce::<L>(surface, boxes, [vertices, triangles], grown(one.place, reach), reach, vertex_triangle);
            }
            let edges = [of_a.edges_of(a), of_b.edges_of(b)];
            meet::<L>(surface, &boxes[EDGES], edges, is_one, grown(other.place, reach), reach, edge_edge);
        }
    }
}

/// A box enlarged by `by`.
#[inline(always)]
fn grown([low, high]: [Vec3A; 2], by: Vec3A) -> [Vec3A; 2] {
    [low - by, high + by]
}

/// Pairs of vertices and triangles whose boxes are within `reach` of each other; vertices outside `place` are skipped.
#[inline(always)]
fn pierce<L: Registers>(
    surface: &Surface,
    boxes: &[Boxes; 3],
    [vertices, triangles]: [Range<usize>; 2],
    place: [Vec3A; 2],
    reach: Vec3A,
    near: &mut Vec<[u32; 2]>,
) {
    for first in vertices.clone().step_by(L::LANES) {
        let mut left = boxes[VERTICES].touching::<L>(first, vertices.end - first, place);
        while left != 0 {
            let item = first + left.trailing_zeros() as usize;
            left &= left - 1;
            let (vertex, around) = (surface.order[item], grown(boxes[VERTICES].get(item), reach));
            for first in triangles.clone().step_by(L::LANES) {
                let mut found = boxes[TRIANGLES].touching::<L>(first, triangles.end - first, around);
                while found != 0 {
                    let triangle = first + found.trailing_zeros() as usize;
                    found &= found - 1;
                    if !surface.triangles[triangle].contains(&vertex) {
                        near.push([vertex, triangle as u32]);
                    }
                }
            }
        }
    }
}

/// The same for edges and other edges, or the same edges.
#[inline(always)]
fn meet<L: Registers>(
    surface: &Surface,
    boxes: &Boxes,
    [edges, others]: [Range<usize>; 2],
    is_one: bool,
    place: [Vec3A; 2],
    reach: Vec3A,
    near: &mut Vec<[u32; 2]>,
) {
    for first in edges.clone().step_by(L::LANES) {
        let mut left = boxes.touching::<L>(first, edges.end - first, place);
        while left != 0 {
            let edge = first + left.trailing_zeros() as usize;
            left &= left - 1;
            let ([i, j], around) = (surface.edges[edge], grown(boxes.get(edge), reach));
            // Within the same edges each pair is visited once.
            let start = if is_one { edge + 1 } else { others.start };
            for first in (start..others.end).step_by(L::LANES) {
                let mut found = boxes.touching::<L>(first, others.end - first, around);
                while found != 0 {
                    let other = first + found.trailing_zeros() as usize;
                    found &= found - 1;
                    let [k, l] = surface.edges[other];
                    if i != k && i != l && j != k && j != l {
                        near.push([edge as u32, other as u32]);
                    }
                }
            }
        }
    }
}
