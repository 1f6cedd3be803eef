//! Bounds are refitted to new paths, of all vertices or of some.

use std::ops::Range;

use glam::Vec3A;

use super::{NodeBounds, Tree};
use crate::contact::detection::boxes::Boxes;
use crate::contact::input::Path;
use crate::contact::surface::Surface;
use crate::contact::surface::normals::normals_on_path;
use crate::kernels::integrate::xyz;

/// Least number of triangles or leaves that are worth a part of a loop.
const GRAIN: usize = 16;
/// Marks of nodes: some of their vertices have new paths, and their triangles, or some around them, do.
pub(crate) const MOVED: u8 = 1;
pub(crate) const TURNED: u8 = 2;

impl Tree {
    /// Refits all bounds to the paths; `boxes` contains the box of each triangle at the midpoint of its path.
    pub(crate) fn refit(&mut self, surface: &Surface, boxes: &Boxes, path: Path<'_>, substeps: f32) {
        let mut normals = std::mem::take(&mut self.normals);
        if self.has_normals() {
            normals.resize(self.leaves.all()[0].end, NodeBounds::NOTHING.normal);
        }
        path.workers.chunks(&mut normals, GRAIN, |first, normals| {
            (first..).zip(normals).for_each(|(triangle, normal)| *normal = normals_of(surface, triangle, path, substeps));
        });
        self.normals = normals;
        let leaves = 1_usize << self.leaves.depth;
        let mut nodes = std::mem::take(&mut self.nodes);
        path.workers.chunks(&mut nodes[leaves..], GRAIN, |first, nodes| {
            (first..).zip(nodes).for_each(|(leaf, node)| *node = self.bounds(leaf, surface, boxes, path));
        });
        for node in (1..leaves).rev() {
            nodes[node] = nodes[2 * node].join(&nodes[2 * node + 1]);
        }
        self.nodes = nodes;
    }

    /// Refits the bounds to new paths of some vertices, and marks the nodes that change.
    pub(crate) fn refit_around(&mut self, vertices: &[u32], surface: &Surface, boxes: &Boxes, path: Path<'_>, substeps: f32) {
        self.before.clear();
        self.before.extend(self.nodes.iter().map(|node| node.normal));
        if self.has_normals() {
            for &triangle in vertices.iter().flat_map(|&vertex| surface.at.of(vertex)) {
                self.normals[triangle as usize] = normals_of(surface, triangle as usize, path, substeps);
            }
        }
        let leaves = 1_usize << self.leaves.depth;
        for leaf in (0..leaves).filter(|leaf| self.marks[leaf + leaves] != 0) {
            self.nodes[leaf + leaves] = self.bounds(leaf, surface, boxes, path);
        }
        for node in (1..leaves).rev() {
            self.marks[node] = self.marks[2 * node] | self.marks[2 * node + 1];
            if self.marks[node] != 0 {
                self.nodes[node] = self.nodes[2 * node].join(&self.nodes[2 * node + 1]);
            }
        }
    }

    /// Marks the leaves that new paths of some vertices change.
    pub(crate) fn mark(&mut self, vertices: &[u32], surface: &Surface) {
        self.marks.clear();
        self.marks.resize(2 << self.leaves.depth, 0);
        let leaves = 1 << self.leaves.depth;
        let first = self.leaves.all()[0].start;
        let leaf_of = |triangle: u32| self.leaf_of[triangle as usize - first] as usize + leaves;
        for &triangle in vertices.iter().flat_map(|&vertex| surface.at.of(vertex)) {
            self.marks[leaf_of(triangle)] |= MOVED;
            if self.has_normals() {
                let around = surface.triangles[triangle as usize].iter().flat_map(|&corner| surface.at.of(corner));
                around.for_each(|&beside| self.marks[leaf_of(beside)] |= TURNED);
            }
        }
    }

    /// The leaves with vertices that have new paths.
    pub(crate) fn moved(&self) -> impl Iterator<Item = usize> {
        let leaves: Range<usize> = 0..1 << self.leaves.depth;
        leaves.filter(|leaf| self.marks[leaf + (1 << self.leaves.depth)] & MOVED != 0)
    }

    /// Whether normals matter: the cloth may meet itself, but bodies are not tested against each other.
    fn has_normals(&self) -> bool {
        !self.around.items.is_empty()
    }

    /// The bounds of a leaf.
    fn bounds(&self, leaf: usize, surface: &Surface, boxes: &Boxes, path: Path<'_>) -> NodeBounds {
        let mut bounds = NodeBounds::NOTHING;
        for triangle in self.leaves.triangles_of(leaf) {
            let [a, b, c] = surface.triangles[triangle].map(|vertex| xyz(path.u[vertex as usize]));
            let step = [a.min(b).min(c), a.max(b).max(c)];
            let place = boxes.bounds(triangle).map(Vec3A::from_array);
            bounds = bounds.join(&NodeBounds { place, step, ..NodeBounds::NOTHING });
        }
        for &triangle in self.around.of(leaf as u32) {
            bounds = bounds.join(&NodeBounds { normal: self.normals[triangle as usize], ..NodeBounds::NOTHING });
        }
        bounds
    }
}

/// Bounds of the unit normals of a triangle on its path.
fn normals_of(surface: &Surface, triangle: usize, path: Path<'_>, substeps: f32) -> [Vec3A; 2] {
    let corners = surface.triangles[triangle].map(|vertex| vertex as usize);
    let (x, u) = (corners.map(|v| xyz(path.x[v])), corners.map(|v| xyz(path.u[v])));
    let margin = corners.map(|v| path.margin[v]).into_iter().fold(0.0, f32::max);
    normals_on_path(x, std::array::from_fn(|k| x[k] + u[k] * substeps), margin)
}
