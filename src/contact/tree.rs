//! Bounding volume hierarchies over the triangles of the cloth and of the bodies. They are built once, refitted to new
//! positions, and traversed for pairs of triangles that may meet.
//!
//! Each is a complete binary tree with its nodes numbered like a binary heap, the root being 1. Therefore both nodes of
//! a compared pair are on the same level if the trees have the same depth, and, as the topology never changes, pairs
//! are always found in the same order.

use glam::Vec3A;
use rayon::prelude::*;

use super::boxes::Boxes;
use super::normals::{are_upright, normals_on_path};
use super::surface::{Leaves, Surface};
use super::{Path, for_chunks};
use crate::kernels::integrate::xyz;
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;

/// Limit on the excess angle ([`Surface::excess`], rad) below which cloth that is not folded over cannot meet itself.
pub(super) const MOST_EXCESS: f32 = 0.6;
/// Leaves per task when refitting.
const GRAIN: usize = 64;
/// Levels that are traversed before the rest is divided into tasks.
const SHARED_LEVELS: u32 = 5;

/// Bounds of a node's triangles: their places (m) at the midpoints of the paths, and their displacements per substep (m). Also
/// bounds of the unit normals of all triangles at their vertices, on the whole path.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub place: [Vec3A; 2],
    pub step: [Vec3A; 2],
    normal: [Vec3A; 2],
}

impl Bounds {
    const NOTHING: Bounds = {
        let inverted = [Vec3A::INFINITY, Vec3A::NEG_INFINITY];
        Bounds { place: inverted, step: inverted, normal: inverted }
    };

    fn join(&self, other: &Bounds) -> Bounds {
        let join = |a: [Vec3A; 2], b: [Vec3A; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        Bounds {
            place: join(self.place, other.place),
            step: join(self.step, other.step),
            normal: join(self.normal, other.normal),
        }
    }

    /// The distance (m) along each axis within which two nodes may contain a pair to list. `margin` (m) is the
    /// thickness.
    pub(super) fn reach(&self, other: &Bounds, margin: f32, substeps: f32) -> Vec3A {
        let relative = (self.step[1] - other.step[0]).max(other.step[1] - self.step[0]).max(Vec3A::ZERO);
        relative * (0.5 * substeps) + margin
    }

    fn is_apart(&self, other: &Bounds, margin: f32, substeps: f32) -> bool {
        let gap = (self.place[0] - other.place[1]).max(other.place[0] - self.place[1]);
        gap.cmpgt(self.reach(other, margin, substeps)).any()
    }
}

/// The number of substeps that detection covers, and the thickness (m).
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    pub substeps: f32,
    pub margin: f32,
}

#[derive(Debug)]
pub(super) struct Tree {
    pub leaves: Leaves,
    depth: u32,
    /// Indexed by heap number; entry 0 is unused.
    nodes: Vec<Bounds>,
    /// Sum of the excess angles (rad) of a node's vertices; infinite if its triangles are not connected by edges.
    excess: Vec<f32>,
    /// For each leaf, the triangles that share a vertex with it, its own among them; none for bodies.
    around: Csr<u32>,
    /// Bounds of the unit normals of each triangle.
    normals: Vec<[Vec3A; 2]>,
    /// For each level, the other nodes of that level that share a vertex with each node.
    beside: Vec<Csr<u32>>,
    frontier: Vec<[u32; 2]>,
    found: Vec<Vec<[u32; 2]>>,
}

impl Tree {
    /// Over the bodies, which are not tested against each other.
    pub(super) fn of_bodies(leaves: Leaves) -> Tree {
        let (depth, nodes) = (leaves.depth, vec![Bounds::NOTHING; 2 << leaves.depth]);
        let around = Csr::new(1 << depth, std::iter::empty());
        let (excess, normals, beside, frontier, found) = Default::default();
        Tree { leaves, depth, nodes, excess, around, normals, beside, frontier, found }
    }

    /// Over the cloth. The surface must contain nothing else yet.
    pub(super) fn of_cloth(surface: &Surface, leaves: Leaves) -> Tree {
        let mut tree = Tree::of_bodies(leaves);
        tree.excess = vec![0.0; tree.nodes.len()];
        let leaf_of = tree.leaves.of_triangles();
        let corners = surface.triangles.iter().enumerate();
        let around = Csr::new(surface.piece.len(), corners.flat_map(|(t, corners)| corners.map(|v| (v, leaf_of[t]))));
        tree.around = triangles_around(surface, &around, tree.leaves.depth);
        tree.sum_excess(surface, &around);
        tree.find_parts(surface, &leaf_of);
        let mut pairs: Vec<[u32; 2]> = Vec::new();
        for vertex in 0..surface.piece.len() as u32 {
            let leaves = around.of(vertex);
            pairs.extend(leaves.iter().flat_map(|&a| leaves.iter().map(move |&b| [a, b])).filter(|[a, b]| a != b));
        }
        for level in (0..=tree.depth).rev() {
            pairs.sort_unstable();
            pairs.dedup();
            tree.beside.push(Csr::new(1 << level, pairs.iter().map(|&[a, b]| (a, b))));
            pairs.iter_mut().for_each(|pair| *pair = pair.map(|node| node >> 1));
            pairs.retain(|[a, b]| a != b);
        }
        tree.beside.reverse();
        tree
    }

    fn sum_excess(&mut self, surface: &Surface, around: &Csr<u32>) {
        for (vertex, &excess) in surface.excess.iter().enumerate().filter(|(_, excess)| **excess > 0.0) {
            let mut nodes: Vec<u32> = around.of(vertex as u32).iter().map(|leaf| leaf + (1 << self.depth)).collect();
            for _ in 0..=self.depth {
                nodes.sort_unstable();
                nodes.dedup();
                nodes.iter_mut().for_each(|node| {
                    self.excess[*node as usize] += excess;
                    *node >>= 1;
                });
            }
        }
    }

    /// Sets the excess of nodes whose triangles are not connected to infinity.
    fn find_parts(&mut self, surface: &Surface, leaf_of: &[u32]) {
        let at_edges = surface.at_edges();
        for level in 0..=self.depth {
            let node = |triangle: u32| (leaf_of[triangle as usize] + (1 << self.depth)) >> (self.depth - level);
            let mut parts = DisjointSets::new(leaf_of.len());
            for edge in 0..surface.edges.len() as u32 {
                for pair in at_edges.of(edge).windows(2).filter(|pair| node(pair[0]) == node(pair[1])) {
                    parts.join([pair[0], pair[1]]);
                }
            }
            for triangle in 1..leaf_of.len() as u32 {
                if node(triangle) == node(triangle - 1) && parts.root(triangle) != parts.root(triangle - 1) {
                    self.excess[node(triangle) as usize] = f32::INFINITY;
                }
            }
        }
    }

    /// The data besides bounds with which nodes are ruled out: excess angles, the triangles around each leaf, and for each
    /// level the nodes that share a vertex.
    #[cfg(feature = "gpu")]
    pub(super) fn culls(&self) -> (&[f32], &Csr<u32>, &[Csr<u32>]) {
        (&self.excess, &self.around, &self.beside)
    }

    /// The bounds of a leaf.
    pub(super) fn leaf(&self, leaf: u32) -> &Bounds {
        &self.nodes[leaf as usize + (1 << self.depth)]
    }

    /// Refits all bounds to the paths; `boxes` contains the box of each triangle at the midpoint of its path.
    pub(super) fn refit(&mut self, surface: &Surface, boxes: &Boxes, path: Path<'_>, substeps: f32) {
        let Tree { leaves: of_leaves, around, normals, .. } = self;
        if !around.items.is_empty() {
            normals.resize(of_leaves.all()[0].end, Bounds::NOTHING.normal);
        }
        for_chunks(path.is_shared, normals, GRAIN, |first, normals| {
            for (normal, corners) in normals.iter_mut().zip(&surface.triangles[first..]) {
                let corners = corners.map(|vertex| vertex as usize);
                let (x, u) = (corners.map(|v| xyz(path.x[v])), corners.map(|v| xyz(path.u[v])));
                let stray = corners.map(|v| path.stray[v]).into_iter().fold(0.0, f32::max);
                *normal = normals_on_path(x, std::array::from_fn(|k| x[k] + u[k] * substeps), stray);
            }
        });
        let leaves = 1_usize << self.depth;
        let (above, below) = self.nodes.split_at_mut(leaves);
        for_chunks(path.is_shared, below, GRAIN, |first, nodes| {
            for (leaf, node) in (first..).zip(nodes) {
                *node = Bounds::NOTHING;
                for triangle in of_leaves.triangles_of(leaf) {
                    let [a, b, c] = surface.triangles[triangle].map(|vertex| xyz(path.u[vertex as usize]));
                    let step = [a.min(b).min(c), a.max(b).max(c)];
                    *node = node.join(&Bounds { place: boxes.get(triangle), step, ..Bounds::NOTHING });
                }
                for &triangle in around.of(leaf as u32) {
                    *node = node.join(&Bounds { normal: normals[triangle as usize], ..Bounds::NOTHING });
                }
            }
        });
        for node in (1..leaves).rev() {
            let child = |index: usize| if index < leaves { above[index] } else { below[index - leaves] };
            above[node] = child(2 * node).join(&child(2 * node + 1));
        }
    }

    /// Finds the pairs of leaves (numbered from 0, the lower first) whose triangles may meet. Their order does not
    /// depend on the number of threads.
    pub(super) fn walk(&mut self, look: Look, is_shared: bool, leaves: &mut Vec<[u32; 2]>) {
        let (mut frontier, mut found) = (std::mem::take(&mut self.frontier), std::mem::take(&mut self.found));
        frontier.clear();
        leaves.clear();
        let top = if is_shared { SHARED_LEVELS.min(self.depth) } else { self.depth };
        self.descend([1, 1], top, look, &mut frontier);
        if top < self.depth {
            let tasks = frontier.len().div_ceil(4);
            found.resize_with(tasks.max(found.len()), Vec::new);
            found[..tasks].par_iter_mut().zip(frontier.par_chunks(4)).for_each(|(found, nodes)| {
                found.clear();
                nodes.iter().for_each(|&pair| self.descend(pair, self.depth, look, found));
            });
            found[..tasks].iter().for_each(|found| leaves.extend_from_slice(found));
        } else {
            leaves.extend_from_slice(&frontier);
        }
        let first = 1 << self.depth;
        leaves.iter_mut().for_each(|pair| *pair = pair.map(|node| node - first));
        (self.frontier, self.found) = (frontier, found);
    }

    /// Finds the pairs of a leaf of this tree and a leaf of another (both numbered from 0) whose triangles may meet.
    /// Their order does not depend on the number of threads.
    pub(super) fn walk_across(&mut self, other: &Tree, look: Look, is_shared: bool, leaves: &mut Vec<[u32; 2]>) {
        let (mut frontier, mut found) = (std::mem::take(&mut self.frontier), std::mem::take(&mut self.found));
        frontier.clear();
        leaves.clear();
        self.descend_across(other, [1, 1], SHARED_LEVELS, look, &mut frontier);
        if is_shared {
            let tasks = frontier.len().div_ceil(4);
            found.resize_with(tasks.max(found.len()), Vec::new);
            found[..tasks].par_iter_mut().zip(frontier.par_chunks(4)).for_each(|(found, nodes)| {
                found.clear();
                nodes.iter().for_each(|&pair| self.descend_across(other, pair, u32::MAX, look, found));
            });
            found[..tasks].iter().for_each(|found| leaves.extend_from_slice(found));
        } else {
            frontier.iter().for_each(|&pair| self.descend_across(other, pair, u32::MAX, look, leaves));
        }
        leaves.iter_mut().for_each(|[a, b]| (*a, *b) = (*a - (1 << self.depth), *b - (1 << other.depth)));
        (self.frontier, self.found) = (frontier, found);
    }

    /// Pairs of nodes of two trees that may meet, at most `levels` below the given pair.
    fn descend_across(&self, other: &Tree, [a, b]: [u32; 2], levels: u32, look: Look, found: &mut Vec<[u32; 2]>) {
        if self.nodes[a as usize].is_apart(&other.nodes[b as usize], look.margin, look.substeps) {
            return;
        }
        let (is_leaf, is_other_leaf) = (a >> self.depth != 0, b >> other.depth != 0);
        if levels == 0 || is_leaf && is_other_leaf {
            return found.push([a, b]);
        }
        let children = |node: u32, is_leaf: bool| if is_leaf { node..node + 1 } else { 2 * node..2 * node + 2 };
        for a in children(a, is_leaf) {
            for b in children(b, is_other_leaf) {
                self.descend_across(other, [a, b], levels - 1, look, found);
            }
        }
    }

    /// Pairs of nodes on `level` that may meet, below the given pair.
    fn descend(&self, [a, b]: [u32; 2], level: u32, look: Look, found: &mut Vec<[u32; 2]>) {
        let here = a.ilog2();
        if self.is_clear([a, b], here, look) {
            return;
        }
        if here == level {
            return found.push([a, b]);
        }
        let [a0, a1, b0, b1] = [2 * a, 2 * a + 1, 2 * b, 2 * b + 1];
        let pairs: &[[u32; 2]] = if a == b { &[[a0, a0], [a1, a1], [a0, a1]] } else { &[[a0, b0], [a0, b1], [a1, b0], [a1, b1]] };
        pairs.iter().for_each(|&pair| self.descend(pair, level, look, found));
    }

    /// Whether two nodes, or a node and itself, certainly do not meet. Besides distance, it uses that connected cloth
    /// whose normals are all within a cone, and which is nearly flat, does not meet itself. The normals include those of all
    /// triangles around the nodes' vertices: without one of them a node has a notch, whose sides meet if it turns over.
    fn is_clear(&self, [a, b]: [u32; 2], level: u32, look: Look) -> bool {
        let (one, other) = (&self.nodes[a as usize], &self.nodes[b as usize]);
        if a != b && one.is_apart(other, look.margin, look.substeps) {
            return true;
        }
        let excess = self.excess[a as usize] + if a == b { 0.0 } else { self.excess[b as usize] };
        excess < MOST_EXCESS
            && are_upright(one.join(other).normal)
            && (a == b || self.beside[level as usize].of(a - (1 << level)).binary_search(&(b - (1 << level))).is_ok())
    }
}

/// For each leaf, the triangles that share a vertex with it; `leaves` are those around each vertex.
fn triangles_around(surface: &Surface, leaves: &Csr<u32>, depth: u32) -> Csr<u32> {
    let mut pairs: Vec<(u32, u32)> = Vec::new();
    for (triangle, corners) in (0..).zip(&surface.triangles) {
        pairs.extend(corners.iter().flat_map(|&vertex| leaves.of(vertex)).map(|&leaf| (leaf, triangle)));
    }
    pairs.sort_unstable();
    pairs.dedup();
    Csr::new(1 << depth, pairs.into_iter())
}

#[cfg(test)]
#[path = "../../tests/unit/contact_tree.rs"]
mod tests;
