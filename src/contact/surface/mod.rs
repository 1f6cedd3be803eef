//! The features that can touch: the vertices, edges and triangles of the cloth and of mesh colliders, in the order of
//! fixed trees over their triangles.

mod caps;
pub(super) mod lanes;
pub(super) mod normals;
pub(crate) mod pairs;

use std::ops::Range;
use std::sync::Arc;

use glam::{Vec3A, Vec4};

use caps::without_caps;

use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::mesh::{self, EdgeIndex, Mesh, follows, is_proper, sides};
use crate::options::Contact;
use crate::simd::MAX_LANES;

/// The least distance at which a pair is held, where cloth coincides at rest: a share of the thickness, larger than what counts as
/// touching.
pub(crate) const LEAST_HELD: f32 = 2e-3;
/// [`Surface::allowance`] as a share of half the least height of the triangles around a vertex.
const FARTHER: f32 = 0.45;
/// Bounds on [`Surface::max_margin`], in units of the thickness.
const MAX_MARGIN: [f32; 2] = [0.3, 1.6];
/// Limit on the margin as a share of the least height of the triangles, so that they do not tilt too far
/// ([`normals_on_path`](normals::normals_on_path)) even if they are somewhat compressed; but slivers have a margin of
/// `SLIVER_MARGIN` thicknesses.
const STEADY: f32 = 0.3;
const SLIVER_MARGIN: f32 = 0.1;
/// The margin (m) of vertices that belong to no triangle: however far they stray, no triangle does.
const FAR: f32 = 1e15;
/// Fewest triangles in a leaf, unless the cloth has fewer; at most, it has twice as many.
pub(crate) const LEAF: usize = 6;

/// The features of the cloth, followed by those of the bodies. They do not change between steps.
pub(crate) struct Surface {
    /// The thickness (m) of contact, and whether the cloth touches itself; otherwise it touches bodies only.
    pub thickness: f32,
    pub has_self_contact: bool,
    /// Triangles in the order of the leaves.
    pub triangles: Vec<[u32; 3]>,
    pub edges: Vec<[u32; 2]>,
    /// The three edges of each triangle, as indices of `edges`.
    pub sides: Vec<[u32; 3]>,
    /// Vertices in the order of the leaves.
    pub order: Vec<u32>,
    /// Position of each vertex at rest (m); w is unused.
    pub rest: Vec<Vec4>,
    /// For each vertex the piece of cloth or the body that it belongs to, and its owner: 0 is the cloth, followed by
    /// the bodies.
    pub piece: Vec<u32>,
    pub owner: Vec<u32>,
    bodies: u32,
    /// The triangles at each vertex, and the vertices to which edges lead from it.
    pub at: Csr<u32>,
    pub ring: Csr<u32>,
    /// How much farther (m) contact may move each vertex in a substep than it was about to move: [`FARTHER`] of half the least
    /// height of the triangles around it, which is taken to be between a tenth of the thickness and the thickness. Pairs that are
    /// closer than this lets both sides move are near, so that no such motion makes features meet unnoticed: see
    /// [`reach`](pairs::reach).
    pub allowance: Vec<f32>,
    /// Largest distance (m) that a vertex may stray from its path; any distance if it belongs to no triangle. It is limited
    /// so that where cloth lies flat, neighboring features are not listed because of it.
    pub max_margin: Vec<f32>,
    /// The angle (rad) of cloth around a vertex in excess of that of a flat, convex sheet. Where it is positive, cloth
    /// can come to lie on itself without turning over.
    pub excess: Vec<f32>,
}

/// The features that each leaf of a tree owns: each vertex, edge and triangle belongs to one leaf, whose features of a
/// kind are consecutive.
#[derive(Debug, Default)]
pub(crate) struct Leaves {
    /// Number of levels of the tree below its root.
    pub depth: u32,
    /// The first triangle, edge and, in [`Surface::order`], vertex of each leaf, and the end of the last leaf's.
    pub triangles: Vec<u32>,
    pub edges: Vec<u32>,
    pub vertices: Vec<u32>,
}

impl Leaves {
    /// The triangles of a leaf.
    pub(crate) fn triangles_of(&self, leaf: usize) -> Range<usize> {
        self.triangles[leaf] as usize..self.triangles[leaf + 1] as usize
    }

    pub(crate) fn edges_of(&self, leaf: usize) -> Range<usize> {
        self.edges[leaf] as usize..self.edges[leaf + 1] as usize
    }

    /// The places in [`Surface::order`] of the vertices of a leaf.
    pub(crate) fn vertices_of(&self, leaf: usize) -> Range<usize> {
        self.vertices[leaf] as usize..self.vertices[leaf + 1] as usize
    }

    /// All triangles, edges and vertices.
    pub(crate) fn all(&self) -> [Range<usize>; 3] {
        [&self.triangles, &self.edges, &self.vertices].map(|starts| starts[0] as usize..starts[starts.len() - 1] as usize)
    }

    /// The leaf of each triangle, in order.
    pub(crate) fn of_triangles(&self) -> Vec<u32> {
        (0..1 << self.depth).flat_map(|leaf| self.triangles_of(leaf).map(move |_| leaf as u32)).collect()
    }
}

impl Surface {
    /// The features of the cloth alone; `None` if it has no triangles with an area. Without `contact`, the cloth touches bodies only.
    pub(crate) fn new(cloth: &Cloth, contact: Option<Contact>) -> Option<(Surface, Leaves)> {
        let Contact { thickness, .. } = contact.unwrap_or_default();
        let triangles = without_caps(&cloth.triangles, &cloth.rest, f64::from(2.0 * LEAST_HELD * thickness));
        if triangles.is_empty() {
            return None;
        }
        let vertices = cloth.rest.len();
        let heights = heights(cloth, &triangles);
        let max_margin = |height: &f32| {
            if *height == f32::INFINITY {
                return FAR;
            }
            let flat = (0.45 * (height - thickness)).clamp(MAX_MARGIN[0] * thickness, MAX_MARGIN[1] * thickness);
            flat.min(STEADY * height).max(SLIVER_MARGIN * thickness)
        };
        let mut surface = Surface {
            thickness,
            has_self_contact: contact.is_some(),
            triangles: Vec::new(),
            edges: Vec::new(),
            sides: Vec::new(),
            order: Vec::new(),
            rest: cloth.rest.clone(),
            piece: DisjointSets::parts_of_triangles(vertices, &cloth.triangles),
            owner: vec![0; vertices],
            bodies: 0,
            at: Csr::new(0, std::iter::empty()),
            ring: Csr::new(0, std::iter::empty()),
            allowance: heights.iter().map(|height| FARTHER * (0.5 * height).clamp(0.1 * thickness, thickness)).collect(),
            max_margin: heights.iter().map(max_margin).collect(),
            excess: Vec::new(),
        };
        let leaves = surface.add(triangles);
        surface.excess = surface.excesses(cloth);
        // The state's arrays end with a full group of lanes, and bodies follow after that.
        surface.lengthen(vertices.next_multiple_of(MAX_LANES), 0);
        Some((surface, leaves))
    }

    /// Adds all bodies.
    pub(crate) fn add_bodies(&mut self, bodies: &[Arc<Mesh>]) -> Leaves {
        let mut all = Vec::new();
        for (owner, mesh) in (1..).zip(bodies) {
            let first = self.rest.len();
            let place = |&triangle: &[u32; 3]| triangle.map(|vertex| vertex + first as u32);
            let proper = mesh.triangles.iter().filter(|triangle| is_proper(triangle));
            all.extend(proper.map(place));
            self.bodies = owner;
            self.lengthen(first + mesh.positions.len(), owner);
            self.piece[first..].fill(first as u32);
            for (rest, x) in self.rest[first..].iter_mut().zip(&mesh.positions) {
                *rest = x.extend(0.0);
            }
        }
        self.lengthen(self.rest.len().next_multiple_of(MAX_LANES), 0);
        self.add(all)
    }

    /// The index of the first vertex of bodies, or the number of vertices.
    pub(crate) fn cloth_vertices(&self) -> usize {
        self.owner.iter().position(|&owner| owner > 0).unwrap_or(self.owner.len())
    }

    /// Number of triangles of the cloth, which come before those of bodies.
    pub(crate) fn cloth_triangles(&self) -> usize {
        self.triangles.partition_point(|corners| self.owner[corners[0] as usize] == 0)
    }

    pub(crate) fn has_bodies(&self) -> bool {
        self.bodies > 0
    }

    /// Extends the arrays to this many vertices.
    fn lengthen(&mut self, vertices: usize, owner: u32) {
        let thickness = self.thickness;
        self.rest.resize(vertices, Vec4::ZERO);
        self.piece.resize(vertices, u32::MAX);
        self.owner.resize(vertices, owner);
        self.allowance.resize(vertices, FARTHER * thickness);
        self.max_margin.resize(vertices, if owner == 0 { FAR } else { 0.5 * thickness });
    }

    /// Adds triangles whose vertices no other triangles use.
    fn add(&mut self, mut triangles: Vec<[u32; 3]>) -> Leaves {
        let (count, vertices) = (triangles.len(), self.rest.len());
        let depth = (count / LEAF).max(1).ilog2();
        let center = |t: &[u32; 3]| t.iter().map(|&v| xyz(self.rest[v as usize])).sum::<Vec3A>();
        split(&mut triangles, Node { number: 0, level: 0 }, count, depth, &|t| (self.piece[t[0] as usize], center(t)));
        let starts: Vec<u32> = (0..=1_usize << depth).map(|number| Node { number, level: depth }.first(count) as u32).collect();
        let mut leaves = Leaves { depth, triangles: starts, ..Leaves::default() };
        let of_triangle = leaves.of_triangles();
        let sorted = mesh::edges(&triangles);
        let index = EdgeIndex::new(&sorted, vertices);
        let (mut of_vertex, mut of_edge) = (vec![u32::MAX; vertices], vec![u32::MAX; sorted.len()]);
        for (&triangle, &leaf) in triangles.iter().zip(&of_triangle).rev() {
            triangle.iter().for_each(|&vertex| of_vertex[vertex as usize] = leaf);
            sides(triangle).for_each(|side| of_edge[index.of(side)] = leaf);
        }
        let (edges, vertices);
        (edges, leaves.edges) = by_leaf(&of_edge, depth);
        (vertices, leaves.vertices) = by_leaf(&of_vertex, depth);
        let firsts = [self.triangles.len(), self.edges.len(), self.order.len()].map(|first| first as u32);
        let mut rank = vec![0; edges.len()];
        (firsts[1]..).zip(&edges).for_each(|(place, &edge)| rank[edge as usize] = place);
        let place = |[i, j]: [u32; 2]| rank[index.of([i.min(j), i.max(j)])];
        self.sides.extend(triangles.iter().map(|&[a, b, c]| [[a, b], [b, c], [c, a]].map(place)));
        self.triangles.extend(triangles);
        self.edges.extend(edges.iter().map(|&edge| sorted[edge as usize]));
        self.order.extend(vertices);
        for (starts, first) in [&mut leaves.triangles, &mut leaves.edges, &mut leaves.vertices].into_iter().zip(firsts) {
            starts.iter_mut().for_each(|start| *start += first);
        }
        let corners = (0..).zip(&self.triangles);
        self.at = Csr::new(self.rest.len(), corners.flat_map(|(triangle, corners)| corners.map(|vertex| (vertex, triangle))));
        self.ring = Csr::new(self.rest.len(), self.edges.iter().flat_map(|&[a, b]| [(a, b), (b, a)]));
        leaves
    }

    /// The triangles at each edge.
    pub(crate) fn at_edges(&self) -> Csr<u32> {
        let sides = self.sides.iter().enumerate();
        Csr::new(self.edges.len(), sides.flat_map(|(triangle, sides)| sides.map(|edge| (edge, triangle as u32))))
    }

    /// Computes [`Surface::excess`].
    ///
    /// A sheet that is convex at rest, and whose normals stay close to one axis, cannot touch itself: it lies over a
    /// convex part of a plane without a fold (Volino and Magnenat-Thalmann 1994). A sheet with a slit or a notch can,
    /// because its border turns the other way there. So can a sheet with more than a full turn around a vertex, and one
    /// where an edge does not have exactly two consistently oriented triangles.
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
            let goes_along = |&triangle: &u32| follows(self.triangles[triangle as usize], *ends);
            let is_odd = match at_edges.of(edge as u32) {
                [_] => {
                    ends.iter().for_each(|&end| borders[end as usize] += 1);
                    false
                }
                [one, other] => goes_along(one) == goes_along(other),
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
        // Rounding errors at flat vertices would add up otherwise.
        (0..angle.len()).map(of).map(|excess| if excess < 0.01 { 0.0 } else { excess }).collect()
    }
}

/// The items in the order of the leaves that own them, and the first item of each leaf.
fn by_leaf(owner: &[u32], depth: u32) -> (Vec<u32>, Vec<u32>) {
    let owned = owner.iter().copied().zip(0..).filter(|&(leaf, _)| leaf != u32::MAX);
    let by_leaf = Csr::new(1 << depth, owned);
    let starts = by_leaf.starts();
    (by_leaf.items, starts)
}

/// The smallest height (m) of the triangles around each vertex; infinite if there are none.
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

/// A node of the tree: a number on a level, where the root is number 0 on level 0.
#[derive(Clone, Copy)]
struct Node {
    number: usize,
    level: u32,
}

impl Node {
    /// The first triangle of the node, of so many triangles in all.
    fn first(self, count: usize) -> usize {
        ((self.number as u64 * count as u64) >> self.level) as usize
    }
}

/// Sorts the triangles of a node into leaves, which are at a depth, level by level: first by piece, then in halves along the longest
/// axis. There are `count` triangles in all.
fn split(triangles: &mut [[u32; 3]], node: Node, count: usize, depth: u32, key: &impl Fn(&[u32; 3]) -> (u32, Vec3A)) {
    if node.level == depth {
        return triangles.sort_unstable();
    }
    let [one, other] = [0, 1].map(|child| Node { number: 2 * node.number + child, level: node.level + 1 });
    let middle = other.first(count) - node.first(count);
    let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    let piece = key(&triangles[0]).0;
    let mut is_one = true;
    for triangle in triangles.iter() {
        let (of, center) = key(triangle);
        (low, high) = (low.min(center), high.max(center));
        is_one &= of == piece;
    }
    let extent = high - low;
    let axis = extent.max_position();
    triangles.select_nth_unstable_by(middle, |a, b| {
        let ((piece_a, a_center), (piece_b, b_center)) = (key(a), key(b));
        let by_piece = if is_one { std::cmp::Ordering::Equal } else { piece_a.cmp(&piece_b) };
        by_piece.then(a_center[axis].total_cmp(&b_center[axis])).then(a.cmp(b))
    });
    let (left, right) = triangles.split_at_mut(middle);
    split(left, one, count, depth, key);
    split(right, other, count, depth, key);
}
