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
//!
//! A normal of the render mesh keeps its products with the triangle's sides and with `n`, up to a common factor. So it turns as the
//! surface does by which the triangle moves positions: exactly, also where it is stretched.

mod triangle_tree;

use glam::{DMat3, DVec3, Vec3};

use crate::kernels::follow::{BoundVertex, cloth_normal, foot, render_normal};
use crate::kernels::limits::MAX_POSITION;
use crate::model::mesh::{Mesh, edges, is_proper};
#[cfg(feature = "gpu")]
use crate::model::vertex_order;
use crate::model::winding::wind_alike;

use triangle_tree::{Near, TriangleTree};

/// Heights below this share of the cloth's extent count as zero.
const FLAT: f64 = 1e-7;
/// If the sine of the angle between smooth normal and triangle plane is smaller than this, the triangle's own normal is
/// used, because the smooth one hardly tells its two sides apart.
const STEEP: f64 = 0.2;

/// Why a mesh could not be bound, or positions or normals could not be applied.
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
    /// A normal is not finite.
    #[error("the normal of vertex {vertex} of the render mesh is {normal}; normals must be finite")]
    Normal {
        /// The vertex.
        vertex: usize,
        /// Its normal.
        normal: Vec3,
    },
    /// The number of normals is not the number of vertices.
    #[error("{given} normals were given for the {expected} vertices of the render mesh; give one for each")]
    NormalCount {
        /// Number of normals.
        given: usize,
        /// Number of vertices.
        expected: usize,
    },
    /// The binding has no normals.
    #[error("the render mesh was bound without normals; bind it by Binding::with_normals")]
    NoNormals,
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
    /// The number of positions or normals is not the number of vertices.
    #[error("{given} items were given for the {expected} vertices of the {mesh} mesh; give one for each vertex")]
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
    /// The cloth's triangles, for its normals; empty if nothing needs them.
    triangles: Vec<[u32; 3]>,
    /// The vertices of the render mesh.
    vertices: Vec<BoundVertex>,
    has_normals: bool,
    farthest: f32,
}

impl Binding {
    /// Binds `render` to `cloth`, both at rest. The time is proportional to the vertices of the render mesh and grows
    /// only logarithmically with the cloth.
    ///
    /// # Errors
    /// If a position is not finite or beyond 1e15 m, a vertex is too far from the cloth, a triangle refers to a vertex
    /// that does not exist, or the cloth has no triangle with an area.
    pub fn new(render: &Mesh, cloth: &Mesh) -> Result<Binding, BindError> {
        Binding::bind(render, None, cloth)
    }

    /// The same with the normals of the render mesh at rest, one for each vertex, of any length: those that it was loaded with,
    /// so that seams stay smooth and hard edges hard. [`Binding::apply_normals`] and
    #[cfg_attr(feature = "gpu", doc = " [`BoundMesh::normals`](crate::BoundMesh::normals) then turn them with the cloth.")]
    #[cfg_attr(not(feature = "gpu"), doc = " `BoundMesh::normals` then turn them with the cloth.")]
    ///
    /// # Errors
    /// As [`Binding::new`], and if there are not as many normals as vertices, or one is not finite.
    pub fn with_normals(render: &Mesh, normals: &[Vec3], cloth: &Mesh) -> Result<Binding, BindError> {
        let (given, expected) = (normals.len(), render.positions.len());
        if given != expected {
            return Err(BindError::NormalCount { given, expected });
        }
        if let Some(vertex) = normals.iter().position(|normal| !normal.is_finite()) {
            return Err(BindError::Normal { vertex, normal: normals[vertex] });
        }
        Binding::bind(render, Some(normals), cloth)
    }

    fn bind(render: &Mesh, render_normals: Option<&[Vec3]>, cloth: &Mesh) -> Result<Binding, BindError> {
        for (name, mesh) in [("render", render), ("cloth", cloth)] {
            if let Some(vertex) = mesh.unbounded_vertex() {
                return Err(BindError::Position { mesh: name, vertex, position: mesh.positions[vertex] });
            }
        }
        let cloth_vertices = cloth.positions.len();
        if let Some((triangle, index)) = cloth.missing_vertex() {
            return Err(BindError::Index { triangle, index, vertices: cloth_vertices });
        }
        let mut triangles = cloth.triangles.clone();
        triangles.retain(is_proper);
        let edges = edges(&triangles);
        wind_alike(&mut triangles, &edges, cloth_vertices);
        let tree = TriangleTree::new(&cloth.positions, &triangles).ok_or(BindError::NoSurface)?;
        let normals = normals(&triangles, &cloth.positions);
        let flat = FLAT * f64::from(tree.extent());
        let (mut vertices, mut farthest) = (Vec::with_capacity(render.positions.len()), 0.0_f32);
        for (vertex, &x) in render.positions.iter().enumerate() {
            let near = tree.nearest(x);
            farthest = farthest.max(near.distance);
            let normal = render_normals.map_or(DVec3::ZERO, |normals| normals[vertex].as_dvec3().normalize_or_zero());
            let corners = near.corners.map(|corner| cloth.positions[corner as usize]);
            let bound = bound_vertex(x, normal, near, corners, near.corners.map(|corner| normals[corner as usize]), flat);
            vertices.push(bound.ok_or(BindError::Far { vertex, position: x })?);
        }
        let has_normals = render_normals.is_some();
        if !has_normals && vertices.iter().all(|vertex| vertex.height == 0.0) {
            triangles = Vec::new();
        }
        Ok(Binding { cloth_vertices, triangles, vertices, has_normals, farthest })
    }

    /// The render mesh's vertices for the GPU. `order` has the mesh's index of each vertex of the cloth.
    #[cfg(feature = "gpu")]
    pub(crate) fn vertices_on_gpu(&self, order: &[u32]) -> Result<Vec<BoundVertex>, BindError> {
        if order.len() != self.cloth_vertices {
            return Err(BindError::OtherCloth { bound: self.cloth_vertices, vertices: order.len() });
        }
        let place = vertex_order::inverse(order);
        let on_gpu =
            |vertex: &BoundVertex| BoundVertex { corners: vertex.corners.map(|corner| place[corner as usize]), ..*vertex };
        Ok(self.vertices.iter().map(on_gpu).collect())
    }

    /// Whether the render mesh was bound with normals.
    #[cfg(feature = "gpu")]
    pub(crate) fn has_normals(&self) -> bool {
        self.has_normals
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
        self.check_lengths(cloth, render)?;
        // Without heights there are no triangles, and no normal is read.
        let normals = if self.triangles.is_empty() { Vec::new() } else { normals(&self.triangles, cloth) };
        for (x, vertex) in render.iter_mut().zip(&self.vertices) {
            let corners = vertex.corners.map(|corner| cloth[corner as usize]);
            *x = foot(vertex, corners);
            if vertex.height != 0.0 {
                *x += cloth_normal(vertex, corners, vertex.corners.map(|corner| normals[corner as usize])) * vertex.height;
            }
        }
        Ok(())
    }

    /// Sets `render` to the unit normals of the render mesh's vertices for the cloth's positions `cloth` (m), both in their mesh's
    /// order. Normals that were 0 at rest stay 0.
    ///
    /// # Errors
    /// If the mesh was bound without normals, or either length is not that mesh's number of vertices; `render` is then unchanged.
    pub fn apply_normals(&self, cloth: &[Vec3], render: &mut [Vec3]) -> Result<(), BindError> {
        if !self.has_normals {
            return Err(BindError::NoNormals);
        }
        self.check_lengths(cloth, render)?;
        let normals = normals(&self.triangles, cloth);
        for (normal, vertex) in render.iter_mut().zip(&self.vertices) {
            let corners = vertex.corners.map(|corner| cloth[corner as usize]);
            let cloth_normal = cloth_normal(vertex, corners, vertex.corners.map(|corner| normals[corner as usize]));
            *normal = render_normal(vertex, corners, cloth_normal);
        }
        Ok(())
    }

    fn check_lengths(&self, cloth: &[Vec3], render: &[Vec3]) -> Result<(), BindError> {
        for (mesh, given, expected) in
            [("cloth", cloth.len(), self.cloth_vertices), ("render", render.len(), self.vertices.len())]
        {
            if given != expected {
                return Err(BindError::Length { mesh, given, expected });
            }
        }
        Ok(())
    }
}

/// The vertex at `x` (m) with a unit normal or 0, bound to the triangle with these corners (m) and normals. A height of at most `flat` (m)
/// counts as zero. Returns `None` if numbers overflow.
fn bound_vertex(
    x: Vec3,
    normal: DVec3,
    Near { corners, weights, distance }: Near,
    at: [Vec3; 3],
    normals: [Vec3; 3],
    flat: f64,
) -> Option<BoundVertex> {
    let [a, b, c] = at.map(Vec3::as_dvec3);
    let own = (b - a).cross(c - a).normalize_or_zero();
    let smooth: DVec3 = (0..3).map(|k| normals[k].as_dvec3() * f64::from(weights[k])).sum();
    let smooth = smooth.normalize_or_zero();
    let (up, normal_weights) = if smooth.dot(own).abs() > STEEP { (smooth, weights) } else { (own, [0.0; 3]) };
    let parts = DMat3::from_cols(b - a, c - a, up).inverse();
    let [of_b, of_c, height] = (parts * (x.as_dvec3() - a)).to_array();
    let normal = [b - a, c - a, up].map(|side| normal.dot(side) as f32);
    // Weights multiply positions of up to 1e15 m.
    let numbers = [1.0 - of_b - of_c, of_b, of_c, height, f64::from(distance)];
    let are_bounded = numbers.iter().all(|number| number.abs() <= f64::from(MAX_POSITION));
    are_bounded.then_some(BoundVertex {
        corners,
        height: if height.abs() > flat { height as f32 } else { 0.0 },
        normal_weights,
        of_b: of_b as f32,
        normal,
        of_c: of_c as f32,
    })
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
