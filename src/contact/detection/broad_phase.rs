//! The broad phase of detection finds candidates: pairs of features whose boxes are within reach of each other.

use std::ops::Range;

use glam::Vec3A;

use super::boxes::Boxes;
use super::tree::{DetectionScope, Tree};
use crate::contact::surface::Surface;
use crate::simd::{Bits, Loop, Registers};

/// Indices of the features' boxes.
pub(crate) const TRIANGLES: usize = 0;
pub(crate) const EDGES: usize = 1;
pub(crate) const VERTICES: usize = 2;
/// Marks the second feature of pairs in leaves that are close to each other at rest, too.
pub(crate) const CLOSE_AT_REST: u32 = 1 << 31;

/// Finds pairs of features of two leaves, or of one, whose boxes are within reach.
pub(crate) struct Candidates<'a> {
    pub surface: &'a Surface,
    pub scope: DetectionScope,
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
        let Candidates { surface, scope, boxes, trees: [cloth, others], is_own, leaves, near } = self;
        let [vertex_triangle, edge_edge] = near;
        for &[a, b] in leaves {
            let (one, other) = (cloth.leaf(a), others.leaf(b));
            let reach = one.reach(other, scope.thickness, scope.substeps);
            let (of_a, of_b) = (&cloth.leaves, &others.leaves);
            let [a, b] = [a as usize, b as usize];
            let is_one = is_own && a == b;
            let mark = if is_own && cloth.are_beside([a, b], 2.0 * scope.thickness) { CLOSE_AT_REST } else { 0 };
            let within = Within { places: [one.place, other.place], reach, mark };
            pierce::<L>(surface, boxes, [of_a.vertices_of(a), of_b.triangles_of(b)], within, vertex_triangle);
            if !is_one {
                let swapped = Within { places: [other.place, one.place], ..within };
                pierce::<L>(surface, boxes, [of_b.vertices_of(b), of_a.triangles_of(a)], swapped, vertex_triangle);
            }
            let edges = [of_a.edges_of(a), of_b.edges_of(b)];
            meet::<L>(surface, &boxes[EDGES], edges, is_one, within, edge_edge);
        }
    }
}

/// The boxes of two leaves, how far (m) their features may be from each other, and the mark of pairs.
#[derive(Clone, Copy)]
struct Within {
    places: [[Vec3A; 2]; 2],
    reach: Vec3A,
    mark: u32,
}

/// Pairs of vertices and triangles whose boxes are within reach of each other.
#[inline(always)]
fn pierce<L: Registers>(
    surface: &Surface,
    boxes: &[Boxes; 3],
    [vertices, triangles]: [Range<usize>; 2],
    Within { places, reach, mark }: Within,
    near: &mut Vec<[u32; 2]>,
) {
    for first in triangles.clone().step_by(L::LANES) {
        let in_lanes = boxes[TRIANGLES].in_lanes::<L>(first, triangles.end - first, places[0], reach);
        if in_lanes.lanes == 0 {
            continue;
        }
        for some in vertices.clone().step_by(L::LANES) {
            let left = boxes[VERTICES].in_lanes::<L>(some, vertices.end - some, places[1], reach).lanes;
            for lane in Bits(left.into()) {
                let item = some + lane;
                let vertex = surface.order[item];
                for lane in Bits(in_lanes.touching(boxes[VERTICES].bounds(item)).into()) {
                    let triangle = first + lane;
                    if !surface.triangles[triangle].contains(&vertex) {
                        near.push([vertex, triangle as u32 | mark]);
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
    Within { places, reach, mark }: Within,
    near: &mut Vec<[u32; 2]>,
) {
    for first in others.clone().step_by(L::LANES) {
        let in_lanes = boxes.in_lanes::<L>(first, others.end - first, places[0], reach);
        if in_lanes.lanes == 0 {
            continue;
        }
        for some in edges.clone().step_by(L::LANES) {
            for lane in Bits(boxes.in_lanes::<L>(some, edges.end - some, places[1], reach).lanes.into()) {
                let edge = some + lane;
                let ([i, j], mut found) = (surface.edges[edge], in_lanes.touching(boxes.bounds(edge)));
                if is_one {
                    // Within the same edges each pair is visited once.
                    found &= u32::MAX.checked_shl((edge + 1).saturating_sub(first) as u32).unwrap_or(0);
                }
                for lane in Bits(found.into()) {
                    let other = first + lane;
                    let [k, l] = surface.edges[other];
                    if i != k && i != l && j != k && j != l {
                        near.push([edge as u32, other as u32 | mark]);
                    }
                }
            }
        }
    }
}
