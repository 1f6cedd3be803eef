//! Binds a render mesh to the coarser mesh that is simulated.
//!
//! # Theory
//! A vertex of the render mesh is `sum b_i x_i + h n`: an affine combination of the corners of the triangle that is
//! nearest at rest, plus a height along the cloth's smooth normal there. That normal interpolates the corners' normals,
//! each the area-weighted mean of the triangles around it, with the barycentric weights of the nearest point, which are
//! never negative. The weights `b_i` are solved for, so the rest shape is reproduced exactly wherever the vertex is,
//! also beyond the cloth's border. Corners and normals move with the cloth, so a rigid motion is reproduced to
//! rounding, and so is a uniform stretch of a triangle. Between its vertices the cloth is flat: where it is bent with
//! radius R, edges of length `l` cut the curve by `l²/8R`.

use glam::{DMat3, DVec3, Vec3};

#[cfg(feature = "gpu")]
use crate::gpu::BoundVertex;
use crate::kernels::limits::{MAX_POSITION, is_bounded};
use crate::kernels::pair::vertex_triangle;
use crate::model::mesh::{Mesh, bounds, edges, is_proper};
#[cfg(feature = "gpu")]
use crate::model::vertex_order;
use crate::model::winding::wind_alike;
use crate::simd::Vector;

/// Number of triangles in a leaf of the search tree.
const LEAF: usize = 4;
/// Heights below this share of the cloth's extent count as zero.
const FLAT: f64 = 1e-7;
/// If the sine of the angle between smooth normal and triangle plane is smaller than this, the triangle's own normal is
/// used, because the smooth one hardly tells its two sides apart.
const STEEP: f64 = 0.2;

/// Why a mesh could not be bound, or positions could not be applied.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BindError {
    /// The cloth has no triangle with an area.
    #[error("the cloth mesh has no triangle with an area; bind to the mesh that is simulated")]
    NoSurface,
    /// A vertex is not finite, or beyond 1e15 m.
    #[error("vertex {vertex} of the {mesh} mesh is at {position}; positions must be finite and within 1e15 m")]
    Position {
        /// `render` or `cloth`.
        mesh: &'static str,
        /// The vertex.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// A vertex is so far from the cloth, compared with the triangle next to it, that numbers overflow.
    #[error(
        "vertex {vertex} of the render mesh is at {position}, too far from the cloth; check the units and places of both meshes"
    )]
    Far {
        /// The vertex.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} of the cloth mesh names vertex {index}, but it has {vertices} vertices (numbered from 0)")]
    Index {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex index in it.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// The number of positions is not the number of vertices.
    #[error("{given} positions were given for the {expected} vertices of the {mesh} mesh; give one for each")]
    Length {
        /// `render` or `cloth`.
        mesh: &'static str,
        /// Number of positions.
        given: usize,
        /// Number of vertices.
        expected: usize,
    },
    /// The binding was made for another mesh than the cloth's.
    #[error(
        "the binding was made for a mesh of {bound} vertices, but the cloth has {vertices}; make it with the deformer's mesh"
    )]
    OtherCloth {
        /// Number of vertices of the mesh that the binding was made for.
        bound: usize,
        /// Number of vertices of the cloth.
        vertices: usize,
    },
    /// The GPU was lost or is out of memory.
    #[error("the render mesh could not be uploaded to the GPU: {reason}; use Binding::apply on the CPU instead")]
    Gpu {
        /// The device's message.
        reason: String,
    },
}

/// A render mesh bound to a coarser cloth. Build it once from both meshes at rest, and apply it to the cloth's
/// positions in every frame.
///
/// Each vertex of the render mesh follows the nearest triangle of the cloth at rest, and keeps its height above it. The
/// render mesh may have seams, several layers, or a hem beyond the cloth's border. Where two layers of the cloth are
/// closer to each other at rest than the render mesh is to either, a vertex may follow the wrong layer: compare their
/// distance with [`Binding::farthest`].
///
/// ```
/// use cloth_deformer::{Binding, Mesh, glam::Vec3};
/// let (cloth, drawn) = (Mesh::grid(28, 28, 1.0, 1.0), Mesh::grid(71, 71, 1.0, 1.0));
/// let binding = Binding::new(&drawn, &cloth)?;
/// let moved: Vec<Vec3> = cloth.positions.iter().map(|x| *x + Vec3::Y).collect(); // Deformer::positions
/// let mut positions = drawn.positions.clone();
/// binding.apply(&moved, &mut positions)?;
/// assert!(positions.iter().zip(&drawn.positions).all(|(x, at_rest)| x.distance(*at_rest + Vec3::Y) < 1e-6));
/// # Ok::<(), cloth_deformer::BindError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Binding {
    cloth_vertices: usize,
    /// The cloth's triangles, for its normals; empty if no vertex has a height.
    triangles: Vec<[u32; 3]>,
    /// One for each vertex of the render mesh.
    feet: Vec<Foot>,
    heights: Vec<Height>,
    farthest: f32,
}

/// An affine combination of three of the cloth's vertices.
#[derive(Debug, Clone, Copy)]
struct Foot {
    corners: [u32; 3],
    weights: [f32; 3],
}

/// The height of a vertex above its foot.
#[derive(Debug, Clone, Copy)]
struct Height {
    vertex: u32,
    /// Along the normal (m).
    along: f32,
    /// Weights of the corners' normals; all 0 means the triangle's own normal.
    weights: [f32; 3],
}

impl Binding {
    /// Binds `render` to `cloth`, both at rest. The time is proportional to the vertices of the render mesh and grows
    /// only logarithmically with the cloth.
    ///
    /// # Errors
    /// If a position is not finite or beyond 1e15 m, a vertex is too far from the cloth, a triangle refers to a vertex
    /// that does not exist, or the cloth has no triangle with an area.
    pub fn new(render: &Mesh, cloth: &Mesh) -> Result<Binding, BindError> {
        for (mesh, positions) in [("render", &render.positions), ("cloth", &cloth.positions)] {
            if let Some(vertex) = positions.iter().position(|x| !is_bounded(*x)) {
                return Err(BindError::Position { mesh, vertex, position: positions[vertex] });
            }
        }
        let vertices = cloth.positions.len();
        for (triangle, corners) in cloth.triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&index| index as usize >= vertices) {
                return Err(BindError::Index { triangle, index, vertices });
            }
        }
        let tree = TriangleTree::new(cloth).ok_or(BindError::NoSurface)?;
        let mut triangles = cloth.triangles.clone();
        triangles.retain(is_proper);
        let edges = edges(&triangles);
        wind_alike(&mut triangles, &edges, vertices);
        let normals = normals(&triangles, &cloth.positions);
        let extent = tree.nodes.first().map_or(0.0, |root| (root.high - root.low).max_element());
        let (mut feet, mut heights, mut farthest) = (Vec::new(), Vec::new(), 0.0_f32);
        for (vertex, &x) in render.positions.iter().enumerate() {
            let Near { corners, weights, distance } = tree.nearest(x);
            farthest = farthest.max(distance);
            let [a, b, c] = corners.map(|corner| cloth.positions[corner as usize].as_dvec3());
            let own = (b - a).cross(c - a).normalize_or_zero();
            let smooth: DVec3 = (0..3).map(|k| normals[corners[k] as usize].as_dvec3() * f64::from(weights[k])).sum();
            let smooth = smooth.normalize_or_zero();
            let (normal, weights) = if smooth.dot(own).abs() > STEEP { (smooth, weights) } else { (own, [0.0; 3]) };
            let [along, across, height] = (DMat3::from_cols(b - a, c - a, normal).inverse() * (x.as_dvec3() - a)).to_array();
            let place = [1.0 - along - across, along, across];
            // Weights multiply positions of up to 1e15 m.
            if ![place[0], along, across, height, f64::from(distance)]
                .iter()
                .all(|number| number.abs() <= f64::from(MAX_POSITION))
            {
                return Err(BindError::Far { vertex, position: x });
            }
            feet.push(Foot { corners, weights: place.map(|weight| weight as f32) });
            if height.abs() > FLAT * f64::from(extent) {
                heights.push(Height { vertex: vertex as u32, along: height as f32, weights });
            }
        }
        let triangles = if heights.is_empty() { Vec::new() } else { triangles };
        Ok(Binding { cloth_vertices: vertices, triangles, feet, heights, farthest })
    }

    /// The render mesh's vertices for the GPU. `order` has the mesh's index of each vertex of the cloth.
    #[cfg(feature = "gpu")]
    pub(crate) fn vertices_on_gpu(&self, order: &[u32]) -> Result<Vec<BoundVertex>, BindError> {
        if order.len() != self.cloth_vertices {
            return Err(BindError::OtherCloth { bound: self.cloth_vertices, vertices: order.len() });
        }
        let place = vertex_order::inverse(order);
        let bound = |foot: &Foot| BoundVertex {
            corners: foot.corners.map(|corner| place[corner as usize]),
            weights: foot.weights,
            ..BoundVertex::default()
        };
        let mut vertices: Vec<BoundVertex> = self.feet.iter().map(bound).collect();
        for &Height { vertex, along, weights } in &self.heights {
            let vertex = &mut vertices[vertex as usize];
            (vertex.along, vertex.normal_weights) = (along, weights);
        }
        Ok(vertices)
    }

    /// The largest distance (m) of a render vertex from the cloth at rest. A large value means that one of the meshes
    /// is misplaced or in other units.
    #[must_use]
    pub fn farthest(&self) -> f32 {
        self.farthest
    }

    /// Sets `render` to the positions (m) of the render mesh's vertices for the cloth's positions `cloth` (m), both in
    /// their mesh's order. Where a position of the cloth is not finite, neither are those of the vertices bound to it.
    ///
    /// # Errors
    /// If either length is not that mesh's number of vertices; `render` is then unchanged.
    pub fn apply(&self, cloth: &[Vec3], render: &mut [Vec3]) -> Result<(), BindError> {
        for (mesh, given, expected) in [("cloth", cloth.len(), self.cloth_vertices), ("render", render.len(), self.feet.len())] {
            if given != expected {
                return Err(BindError::Length { mesh, given, expected });
            }
        }
        for (x, &Foot { corners, weights }) in render.iter_mut().zip(&self.feet) {
            let [a, b, c] = corners.map(|corner| cloth[corner as usize]);
            *x = a * weights[0] + b * weights[1] + c * weights[2];
        }
        if self.heights.is_empty() {
            return Ok(());
        }
        let normals = normals(&self.triangles, cloth);
        for &Height { vertex, along, weights } in &self.heights {
            let corners = self.feet[vertex as usize].corners;
            let [a, b, c] = corners.map(|corner| normals[corner as usize]);
            let smooth = a * weights[0] + b * weights[1] + c * weights[2];
            let normal = smooth.try_normalize().unwrap_or_else(|| {
                let [a, b, c] = corners.map(|corner| cloth[corner as usize]);
                (b - a).cross(c - a).normalize_or_zero()
            });
            render[vertex as usize] += normal * along;
        }
        Ok(())
    }
}

/// Unit normals of the vertices: the area-weighted mean over their triangles, or 0 where there is no area.
fn normals(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|corner| positions[corner as usize]);
        let area = (b - a).cross(c - a);
        corners.iter().for_each(|&corner| normals[corner as usize] += area);
    }
    normals.iter_mut().for_each(|normal| *normal = normal.normalize_or_zero());
    normals
}

/// The nearest point of the cloth.
#[derive(Debug, Clone, Copy)]
struct Near {
    corners: [u32; 3],
    /// Barycentric weights of the corners, never negative.
    weights: [f32; 3],
    distance: f32,
}

/// A tree of bounding boxes over the triangles that have an area.
struct TriangleTree<'a> {
    positions: &'a [Vec3],
    triangles: Vec<[u32; 3]>,
    /// The root first; children come after their parents.
    nodes: Vec<Node>,
}

struct Node {
    low: Vec3,
    high: Vec3,
    /// A leaf's range of triangles, or the range of the two children in `nodes`.
    range: std::ops::Range<usize>,
    is_leaf: bool,
}

impl<'a> TriangleTree<'a> {
    /// `None` if no triangle has an area.
    fn new(cloth: &'a Mesh) -> Option<TriangleTree<'a>> {
        let positions = &cloth.positions;
        let has_area = |corners: &&[u32; 3]| {
            let [a, b, c] = corners.map(|corner| positions[corner as usize].as_dvec3());
            let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
            (b - a).cross(c - a).length() > 1e-6 * longest
        };
        let triangles: Vec<[u32; 3]> = cloth.triangles.iter().filter(has_area).copied().collect();
        let mut tree = TriangleTree { positions, triangles, nodes: Vec::new() };
        let all = 0..tree.triangles.len();
        tree.nodes.push(tree.node(all.clone()));
        tree.split(0, all.clone());
        (!all.is_empty()).then_some(tree)
    }

    fn node(&self, range: std::ops::Range<usize>) -> Node {
        let [low, high] = bounds(self.triangles[range.clone()].iter().flatten().map(|&corner| self.positions[corner as usize]));
        Node { low, high, range, is_leaf: true }
    }

    /// Splits a node of more than [`LEAF`] triangles at the median along its longest side, recursively.
    fn split(&mut self, node: usize, range: std::ops::Range<usize>) {
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
    fn nearest(&self, x: Vec3) -> Near {
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
