//! Bounding volume hierarchies over the triangles of the cloth and of the bodies. They are built once, refitted to new
//! positions, and traversed for pairs of triangles that may meet.
//!
//! Each is a complete binary tree with its nodes numbered like a binary heap, the root being 1. Therefore both nodes of
//! a compared pair are on the same level if the trees have the same depth, and, as the topology never changes, pairs
//! are always found in the same order.

mod refit;
mod walk;

use glam::Vec3A;

use crate::contact::surface::normals::in_one_cone;
use crate::contact::surface::{Leaves, Surface};
use crate::kernels::integrate::xyz;
use crate::model::csr::{Csr, distinct};
use crate::model::disjoint_sets::DisjointSets;
pub(crate) use walk::Walk;

/// Limit on the excess angle ([`Surface::excess`], rad) below which cloth that is not folded over cannot meet itself.
pub(crate) const MAX_EXCESS: f32 = 0.6;

/// By what distances are enlarged that are compared with rounded ones.
const ROUNDED: f32 = 1.01;

/// Bounds of a node's triangles: their places (m) at the midpoints of the paths, and their displacements per substep (m). Also
/// bounds of the unit normals of all triangles at their vertices, on the whole path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeBounds {
    pub place: [Vec3A; 2],
    pub step: [Vec3A; 2],
    normal: [Vec3A; 2],
}

impl NodeBounds {
    const NOTHING: NodeBounds = {
        let inverted = [Vec3A::INFINITY, Vec3A::NEG_INFINITY];
        NodeBounds { place: inverted, step: inverted, normal: inverted }
    };

    fn join(&self, other: &NodeBounds) -> NodeBounds {
        let join = |a: [Vec3A; 2], b: [Vec3A; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        NodeBounds {
            place: join(self.place, other.place),
            step: join(self.step, other.step),
            normal: join(self.normal, other.normal),
        }
    }

    /// The distance (m) along each axis within which two nodes may contain a pair to list: the thickness (m), and by how
    /// much they may approach each other in half of the substeps.
    pub(crate) fn reach(&self, other: &NodeBounds, thickness: f32, substeps: f32) -> Vec3A {
        let relative = (self.step[1] - other.step[0]).max(other.step[1] - self.step[0]).max(Vec3A::ZERO);
        relative * (0.5 * substeps) + thickness
    }

    fn is_apart(&self, other: &NodeBounds, thickness: f32, substeps: f32) -> bool {
        let gap = (self.place[0] - other.place[1]).max(other.place[0] - self.place[1]);
        gap.cmpgt(self.reach(other, thickness, substeps)).any()
    }
}

/// What detection covers: a number of substeps, and pairs within the thickness (m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct DetectionScope {
    pub substeps: f32,
    pub thickness: f32,
}

pub(crate) struct Tree {
    pub leaves: Leaves,
    /// The leaf of each triangle.
    leaf_of: Vec<u32>,
    /// Indexed by heap number; entry 0 is unused.
    nodes: Vec<NodeBounds>,
    /// Sum of the excess angles (rad) of a node's vertices; infinite if its triangles are not connected by edges.
    pub excess: Vec<f32>,
    /// The box of each leaf at rest (m).
    rest: Vec<[Vec3A; 2]>,
    /// For each leaf, the triangles that share a vertex with it, its own among them; none for bodies.
    pub around: Csr<u32>,
    /// Bounds of the unit normals of each triangle.
    normals: Vec<[Vec3A; 2]>,
    /// For each level, the other nodes of that level that share a vertex with each node.
    pub beside: Vec<Csr<u32>>,
    /// What changed in each node when it was last refitted in part, and the bounds of its normals before.
    marks: Vec<u8>,
    before: Vec<[Vec3A; 2]>,
    frontier: Vec<walk::Pair>,
    found: Vec<Vec<walk::Pair>>,
}

impl Tree {
    /// Over the bodies, which are not tested against each other.
    pub(crate) fn of_bodies(leaves: Leaves) -> Tree {
        let (leaf_of, nodes) = (leaves.of_triangles(), vec![NodeBounds::NOTHING; 2 << leaves.depth]);
        let around = Csr::new(1 << leaves.depth, std::iter::empty());
        let (excess, rest, normals, beside, marks, before, frontier, found) = Default::default();
        Tree { leaves, leaf_of, nodes, excess, rest, around, normals, beside, marks, before, frontier, found }
    }

    /// Over the cloth. The surface must contain nothing else yet.
    pub(crate) fn of_cloth(surface: &Surface, leaves: Leaves) -> Tree {
        let mut tree = Tree::of_bodies(leaves);
        tree.excess = vec![0.0; tree.nodes.len()];
        let at_rest = |triangle: &[u32; 3]| triangle.map(|vertex| xyz(surface.rest[vertex as usize]));
        let boxed = |leaf: usize| {
            let corners = surface.triangles[tree.leaves.triangles_of(leaf)].iter().flat_map(at_rest);
            corners.fold(NodeBounds::NOTHING.place, |[low, high], x| [low.min(x), high.max(x)])
        };
        tree.rest = (0..1 << tree.leaves.depth).map(boxed).collect();
        let leaf_of = tree.leaf_of.clone();
        // The leaves around each vertex.
        let corners = surface.triangles.iter().zip(&leaf_of);
        let around =
            rows_of(surface.piece.len(), corners.flat_map(|(corners, &leaf)| corners.map(|vertex| [vertex, leaf])).collect());
        tree.around = triangles_around(surface, &around, tree.leaves.depth);
        tree.sum_excess(surface, &around);
        tree.find_parts(surface, &leaf_of);
        let mut pairs: Vec<[u32; 2]> = Vec::new();
        for vertex in 0..surface.piece.len() as u32 {
            let leaves = around.of(vertex);
            pairs.extend(leaves.iter().flat_map(|&a| leaves.iter().map(move |&b| [a, b])).filter(|[a, b]| a != b));
        }
        for level in (0..=tree.leaves.depth).rev() {
            pairs = distinct(pairs);
            tree.beside.push(Csr::new(1 << level, pairs.iter().map(|&[a, b]| (a, b))));
            pairs.iter_mut().for_each(|pair| *pair = pair.map(|node| node >> 1));
            pairs.retain(|[a, b]| a != b);
        }
        tree.beside.reverse();
        tree
    }

    fn sum_excess(&mut self, surface: &Surface, around: &Csr<u32>) {
        for (vertex, &excess) in surface.excess.iter().enumerate().filter(|(_, excess)| **excess > 0.0) {
            let mut nodes: Vec<u32> = around.of(vertex as u32).iter().map(|leaf| leaf + (1 << self.leaves.depth)).collect();
            for _ in 0..=self.leaves.depth {
                nodes = distinct(nodes);
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
        for level in 0..=self.leaves.depth {
            let node = |triangle: u32| (leaf_of[triangle as usize] + (1 << self.leaves.depth)) >> (self.leaves.depth - level);
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

    /// Whether features of two leaves of the cloth may be within a distance (m) at rest.
    pub(crate) fn are_beside(&self, [a, b]: [usize; 2], distance: f32) -> bool {
        let ([low, high], [other_low, other_high]) = (self.rest[a], self.rest[b]);
        (low - other_high).max(other_low - high).cmple(Vec3A::splat(ROUNDED * distance)).all()
    }

    /// The bounds of a leaf.
    pub(crate) fn leaf(&self, leaf: u32) -> &NodeBounds {
        &self.nodes[leaf as usize + (1 << self.leaves.depth)]
    }
}

/// For each leaf, the triangles that share a vertex with it; `leaves` are those around each vertex.
fn triangles_around(surface: &Surface, leaves: &Csr<u32>, depth: u32) -> Csr<u32> {
    let mut pairs: Vec<[u32; 2]> = Vec::new();
    for (triangle, corners) in (0..).zip(&surface.triangles) {
        pairs.extend(corners.iter().flat_map(|&vertex| leaves.of(vertex)).map(|&leaf| [leaf, triangle]));
    }
    rows_of(1 << depth, pairs)
}

/// The second numbers of pairs for each first one, in ascending order, each once.
fn rows_of(rows: usize, pairs: Vec<[u32; 2]>) -> Csr<u32> {
    Csr::new(rows, distinct(pairs).into_iter().map(<(u32, u32)>::from))
}

#[cfg(test)]
#[path = "../../../../tests/unit/contact_tree.rs"]
mod tests;
