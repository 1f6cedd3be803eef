//! What can touch: the vertices, edges and triangles of a cloth, in the order of a fixed tree over its triangles.

use std::ops::Range;

use glam::Vec3A;

use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::mesh::{self, EdgeIndex, sides};

/// [`Surface::roam`] (m per m of thickness), at least and at most.
const ROAM: [f32; 2] = [0.3, 1.6];
/// Triangles in a leaf, at least.
const LEAF: usize = 6;

/// A cloth's features. Nothing of it changes.
#[derive(Debug)]
pub(super) struct Surface {
    /// Triangles in the order of the leaves.
    pub triangles: Vec<[u32; 3]>,
    pub edges: Vec<[u32; 2]>,
    /// The three edges of each triangle.
    pub sides: Vec<[u32; 3]>,
    /// The piece of cloth that each vertex belongs to.
    pub piece: Vec<u32>,
    /// How near (m) to half its rest distance from anything not beside it a vertex may be, at least.
    pub reach: Vec<f32>,
    /// How far (m) a vertex may stray from its path, at most: where it lies flat nothing that is beside it comes to be listed by that.
    pub roam: Vec<f32>,
    /// By how much (rad) there is more cloth around a vertex than a flat, convex sheet has: what can come to lie on itself without
    /// turning over.
    pub excess: Vec<f32>,
    pub leaves: Leaves,
}

/// What the leaves of a tree own: each vertex, edge and triangle is owned by one leaf, whose features of a kind come one after another.
#[derive(Debug, Default)]
pub(super) struct Leaves {
    /// Levels of the tree below its root.
    pub depth: u32,
    /// Where the triangles, edges and vertices of each leaf begin, and those of the last end.
    pub triangles: Vec<u32>,
    pub edges: Vec<u32>,
    pub vertices: Vec<u32>,
    /// The vertices in the order of the leaves.
    pub order: Vec<u32>,
}

impl Leaves {
    /// The triangles of a leaf.
    pub(super) fn triangles_of(&self, leaf: usize) -> Range<usize> {
        self.triangles[leaf] as usize..self.triangles[leaf + 1] as usize
    }

    pub(super) fn edges_of(&self, leaf: usize) -> Range<usize> {
        self.edges[leaf] as usize..self.edges[leaf + 1] as usize
    }

    /// Places in [`Leaves::order`] of the vertices of a leaf.
    pub(super) fn vertices_of(&self, leaf: usize) -> Range<usize> {
        self.vertices[leaf] as usize..self.vertices[leaf + 1] as usize
    }

    /// The leaf of each triangle.
    pub(super) fn of_triangles(&self) -> Vec<u32> {
        (0..1 << self.depth).flat_map(|leaf| self.triangles_of(leaf).map(move |_| leaf as u32)).collect()
    }
}

impl Surface {
    /// None if the cloth has no triangles.
    pub(super) fn new(cloth: &Cloth, thickness: f32) -> Option<Surface> {
        let count = cloth.triangles.len();
        let depth = (count / LEAF).max(1).ilog2();
        let mut pieces = DisjointSets::new(cloth.rest.len());
        cloth.triangles.iter().for_each(|&[a, b, c]| {
            pieces.join([a, b]);
            pieces.join([b, c]);
        });
        let piece: Vec<u32> = (0..cloth.rest.len() as u32).map(|vertex| pieces.root(vertex)).collect();
        let mut triangles = cloth.triangles.clone();
        let center = |t: &[u32; 3]| t.iter().map(|&v| xyz(cloth.rest[v as usize])).sum::<Vec3A>();
        split(&mut triangles, 0..count, count, depth, &|t| (piece[t[0] as usize], center(t)));

        let starts: Vec<u32> = (0..=1_usize << depth).map(|leaf| ((leaf * count) >> depth) as u32).collect();
        let mut leaves = Leaves { depth, triangles: starts, ..Leaves::default() };
        let of_triangle = leaves.of_triangles();
        let sorted = mesh::edges(&triangles);
        let index = EdgeIndex::new(&sorted, cloth.rest.len());
        let (mut of_vertex, mut of_edge) = (vec![u32::MAX; cloth.rest.len()], vec![u32::MAX; sorted.len()]);
        for (&triangle, &leaf) in triangles.iter().zip(&of_triangle).rev() {
            triangle.iter().for_each(|&vertex| of_vertex[vertex as usize] = leaf);
            sides(triangle).for_each(|side| of_edge[index.of(side)] = leaf);
        }
        let order;
        (order, leaves.edges) = by_leaf(&of_edge, depth);
        (leaves.order, leaves.vertices) = by_leaf(&of_vertex, depth);
        let mut rank = vec![0; order.len()];
        (0_u32..).zip(&order).for_each(|(place, &edge)| rank[edge as usize] = place);
        let sides: Vec<[u32; 3]> = triangles
            .iter()
            .map(|&t| {
                let mut of = sides(t).map(|side| rank[index.of(side)]);
                std::array::from_fn(|_| of.next().expect("a triangle of the cloth has three sides"))
            })
            .collect();
        let edges: Vec<[u32; 2]> = order.iter().map(|&edge| sorted[edge as usize]).collect();
        let heights = heights(cloth, &triangles);
        let reach = heights.iter().map(|height| (0.5 * height).clamp(0.1 * thickness, thickness)).collect();
        let roam = |height: &f32| (0.45 * (height - thickness)).clamp(ROAM[0] * thickness, ROAM[1] * thickness);
        let roam = heights.iter().map(roam).collect();
        let mut surface = Surface { reach, roam, excess: Vec::new(), triangles, edges, sides, piece, leaves };
        surface.excess = surface.excesses(cloth);
        (count > 0).then_some(surface)
    }

    /// The triangles at each edge.
    pub(super) fn at_edges(&self) -> Csr<u32> {
        let sides = self.sides.iter().enumerate();
        Csr::new(self.edges.len(), sides.flat_map(|(triangle, sides)| sides.map(|edge| (edge, triangle as u32))))
    }

    /// [`Surface::excess`].
    ///
    /// A sheet that is convex at rest, and whose normals stay near one axis, cannot reach itself: it lies over a convex part of a plane
    /// without a fold (Volino and Magnenat-Thalmann 1994). One with a slit or a notch can: its border turns the other way there. So can one
    /// with more than a full turn around a vertex, and wherever triangles meet otherwise than two at an edge.
    fn excesses(&self, cloth: &Cloth) -> Vec<f32> {
        let mut angle = vec![0.0_f32; cloth.rest.len()];
        for &triangle in &self.triangles {
            let x = triangle.map(|vertex| xyz(cloth.rest[vertex as usize]));
            for corner in 0..3 {
                let (a, b) = (x[(corner + 1) % 3] - x[corner], x[(corner + 2) % 3] - x[corner]);
                angle[triangle[corner] as usize] += a.cross(b).length().atan2(a.dot(b));
            }
        }
        let (mut borders, mut odd) = (vec![0_u32; angle.len()], vec![false; angle.len()]);
        let at_edges = self.at_edges();
        for (edge, ends) in self.edges.iter().enumerate() {
            let follows = |&triangle: &u32| {
                let [a, b, c] = self.triangles[triangle as usize];
                [[a, b], [b, c], [c, a]].contains(ends)
            };
            let is_odd = match at_edges.of(edge as u32) {
                [_] => {
                    ends.iter().for_each(|&end| borders[end as usize] += 1);
                    false
                }
                [one, other] => follows(one) == follows(other),
                _ => true,
            };
            ends.iter().for_each(|&end| odd[end as usize] |= is_odd);
        }
        let pi = std::f32::consts::PI;
        let of = |vertex: usize| match borders[vertex] {
            _ if odd[vertex] => pi,
            0 => angle[vertex] - 2.0 * pi,
            2 => angle[vertex] - pi,
            _ => pi,
        };
        // What rounding leaves of a flat vertex would add up.
        (0..angle.len()).map(of).map(|excess| if excess < 0.01 { 0.0 } else { excess }).collect()
    }
}

/// Items in the order of the leaves that own them, and where those of each leaf begin.
fn by_leaf(owner: &[u32], depth: u32) -> (Vec<u32>, Vec<u32>) {
    let mut order: Vec<u32> = (0..owner.len() as u32).filter(|&item| owner[item as usize] != u32::MAX).collect();
    order.sort_by_key(|&item| owner[item as usize]);
    let starts = (0..=1_u32 << depth).map(|leaf| order.partition_point(|&item| owner[item as usize] < leaf) as u32);
    let starts = starts.collect();
    (order, starts)
}

/// The least height (m) of the triangles around each vertex; infinite where there is none.
fn heights(cloth: &Cloth, triangles: &[[u32; 3]]) -> Vec<f32> {
    let mut heights = vec![f32::INFINITY; cloth.rest.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| xyz(cloth.rest[vertex as usize]));
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let height = (b - a).cross(c - a).length() / longest.max(1e-30);
        triangle.iter().for_each(|&vertex| heights[vertex as usize] = heights[vertex as usize].min(height));
    }
    heights
}

/// Sorts a range of all triangles into leaves, level by level: pieces apart first, then halves along the longest axis.
fn split(triangles: &mut [[u32; 3]], range: Range<usize>, count: usize, depth: u32, key: &impl Fn(&[u32; 3]) -> (u32, Vec3A)) {
    // Of node `index` of so many levels above the leaves; the root is the first of all.
    fn recurse(
        triangles: &mut [[u32; 3]],
        first: usize,
        node: usize,
        level: u32,
        count: usize,
        depth: u32,
        key: &impl Fn(&[u32; 3]) -> (u32, Vec3A),
    ) {
        if level == depth {
            return triangles.sort_unstable();
        }
        let middle = (((2 * node + 1) * count) >> (level + 1)) - first;
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let piece = key(&triangles[0]).0;
        let mut is_one = true;
        for triangle in triangles.iter() {
            let (of, center) = key(triangle);
            (low, high) = (low.min(center), high.max(center));
            is_one &= of == piece;
        }
        let extent = high - low;
        let axis = if extent.x >= extent.y && extent.x >= extent.z { 0 } else { 1 + usize::from(extent.z > extent.y) };
        triangles.select_nth_unstable_by(middle, |a, b| {
            let ((piece_a, a_center), (piece_b, b_center)) = (key(a), key(b));
            let by_piece = if is_one { std::cmp::Ordering::Equal } else { piece_a.cmp(&piece_b) };
            by_piece.then(a_center[axis].total_cmp(&b_center[axis])).then(a.cmp(b))
        });
        let (left, right) = triangles.split_at_mut(middle);
        recurse(left, first, 2 * node, level + 1, count, depth, key);
        recurse(right, first + middle, 2 * node + 1, level + 1, count, depth, key);
    }
    if !range.is_empty() {
        recurse(&mut triangles[range], 0, 0, 0, count, depth, key);
    }
}
