//! The triangle of the cloth that is nearest to a point.

use std::ops::Range;

use glam::Vec3;

use crate::kernels::pair::vertex_triangle;
use crate::model::mesh::bounds;
use crate::simd::Vector;

/// Number of triangles in a leaf.
const LEAF: usize = 4;

/// The nearest point of the cloth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    pub corners: [u32; 3],
    /// Barycentric weights of the corners, never negative.
    pub weights: [f32; 3],
    pub distance: f32,
}

/// A tree of bounding boxes over the triangles that have an area.
pub(super) struct TriangleTree<'a> {
    positions: &'a [Vec3],
    triangles: Vec<[u32; 3]>,
    /// The root first; children come after their parents.
    nodes: Vec<Node>,
}

struct Node {
    low: Vec3,
    high: Vec3,
    /// A leaf's range of triangles, or the range of the two children in `nodes`.
    range: Range<usize>,
    is_leaf: bool,
}

impl<'a> TriangleTree<'a> {
    /// `None` if no triangle has an area.
    pub(super) fn new(positions: &'a [Vec3], triangles: &[[u32; 3]]) -> Option<TriangleTree<'a>> {
        let has_area = |corners: &&[u32; 3]| {
            let [a, b, c] = corners.map(|corner| positions[corner as usize].as_dvec3());
            let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
            (b - a).cross(c - a).length() > 1e-6 * longest
        };
        let triangles: Vec<[u32; 3]> = triangles.iter().filter(has_area).copied().collect();
        let mut tree = TriangleTree { positions, triangles, nodes: Vec::new() };
        let all = 0..tree.triangles.len();
        tree.nodes.push(tree.node(all.clone()));
        tree.split(0, all.clone());
        (!all.is_empty()).then_some(tree)
    }

    /// The longest side (m) of the box around the triangles.
    pub(super) fn extent(&self) -> f32 {
        (self.nodes[0].high - self.nodes[0].low).max_element()
    }

    fn node(&self, range: Range<usize>) -> Node {
        let [low, high] = bounds(self.triangles[range.clone()].iter().flatten().map(|&corner| self.positions[corner as usize]));
        Node { low, high, range, is_leaf: true }
    }

    /// Splits a node of more than [`LEAF`] triangles at the median along its longest side, recursively.
    fn split(&mut self, node: usize, range: Range<usize>) {
        if range.len() <= LEAF {
            return;
        }
        let extent = self.nodes[node].high - self.nodes[node].low;
        let axis = extent.max_position();
        let positions = self.positions;
        let center = |corners: &[u32; 3]| corners.iter().map(|&corner| positions[corner as usize][axis]).sum::<f32>();
        let middle = range.len() / 2;
        self.triangles[range.clone()].select_nth_unstable_by(middle, |a, b| center(a).total_cmp(&center(b)));
        let halves = [range.start..range.start + middle, range.start + middle..range.end];
        let first = self.nodes.len();
        let made = halves.clone().map(|half| self.node(half));
        self.nodes.extend(made);
        (self.nodes[node].range, self.nodes[node].is_leaf) = (first..first + 2, false);
        let [left, right] = halves;
        self.split(first, left);
        self.split(first + 1, right);
    }

    /// The nearest point to `x`.
    pub(super) fn nearest(&self, x: Vec3) -> Near {
        let mut near = Near { corners: [0; 3], weights: [1.0, 0.0, 0.0], distance: f32::INFINITY };
        self.search(0, x, &mut near);
        near
    }

    fn search(&self, node: usize, x: Vec3, near: &mut Near) {
        let Node { range, is_leaf, .. } = &self.nodes[node];
        if !is_leaf {
            let mut children = [range.start, range.start + 1].map(|child| (self.away(child, x), child));
            children.sort_by(|a, b| a.0.total_cmp(&b.0));
            children.into_iter().for_each(|(away, child)| {
                if away < near.distance {
                    self.search(child, x, near);
                }
            });
            return;
        }
        for &corners in &self.triangles[range.clone()] {
            let [a, b, c] = corners.map(|corner| self.positions[corner as usize]);
            // Coordinates relative to a corner, for precision. `vertex_triangle` returns the corners' weights negated.
            let at = |v: Vec3| Vector::<f32>::splat((v - a).to_array());
            let [_, u, v, w] = vertex_triangle([at(x), at(a), at(b), at(c)]).map(|weight| -weight);
            let distance = x.distance(a * u + b * v + c * w);
            if distance < near.distance || near.distance.is_infinite() {
                *near = Near { corners, weights: [u, v, w], distance };
            }
        }
    }

    /// A lower bound of the distance (m) of `x` from a node's triangles.
    fn away(&self, node: usize, x: Vec3) -> f32 {
        let Node { low, high, .. } = &self.nodes[node];
        (*low - x).max(x - *high).max(Vec3::ZERO).length()
    }
}
