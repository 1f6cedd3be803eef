//! Triangle meshes: the shape the cloth is cut from.

use std::borrow::Borrow;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::kernels::limits::is_bounded;
use crate::model::csr::{Csr, distinct};
use crate::record::{Recorded, Tape, Unreadable};

/// A triangle mesh: vertex positions (m) and vertex indices, three a triangle.
///
/// Triangles hang together where they name the same vertex. Meshes from glTF or STL files name several at one place, along seams of
/// texture coordinates or for every triangle, and come apart there; weld them first, and draw the original with a
/// [`Binding`](crate::Binding).
///
/// Any triangles will do: open or closed, several pieces, edges with three or more triangles, vertices that no triangle
/// uses, which stay where they are, up to rounding if the cloth is far from them (in a mesh without edges all fall as points). A triangle that names a vertex twice is an
/// edge without area: a thread.
/// [`Deformer::new`](crate::Deformer::new) checks indices and positions.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Positions (m), one per vertex.
    pub positions: Vec<Vec3>,
    /// Vertex indices of each triangle, counter-clockwise seen from its front.
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh is equal to itself without a look at its vertices: a collider that rests is compared in every step.
impl PartialEq for Mesh {
    fn eq(&self, other: &Mesh) -> bool {
        std::ptr::eq(self, other) || self.positions == other.positions && self.triangles == other.triangles
    }
}

impl Mesh {
    /// A rectangle of `columns` x `rows` vertices in the xz-plane, centered on the origin, its front up (+y):
    /// `width` (m) along x, `height` (m) along z. Vertices are numbered row by row; all diagonals run the same way.
    ///
    /// With fewer than two columns or rows there is no area, and so no triangle.
    #[must_use]
    pub fn grid(columns: u32, rows: u32, width: f32, height: f32) -> Mesh {
        let along = |index: u32, count: u32, length: f32| length * (index as f32 / count.saturating_sub(1).max(1) as f32 - 0.5);
        let positions = (0..rows)
            .flat_map(|row| (0..columns).map(move |column| (column, row)))
            .map(|(column, row)| Vec3::new(along(column, columns, width), 0.0, along(row, rows, height)))
            .collect();
        let mut triangles = Vec::new();
        for row in 1..rows {
            for column in 1..columns {
                let d = row * columns + column;
                let (a, b, c) = (d - columns - 1, d - columns, d - 1);
                triangles.push([a, c, b]);
                triangles.push([b, c, d]);
            }
        }
        Mesh { positions, triangles }
    }

    /// Whether both meshes have the same triangles and the same number of vertices.
    pub(crate) fn has_triangles_of(&self, other: &Mesh) -> bool {
        // Numbers are compared many at a time, triangles one by one.
        let has_same = || self.triangles.as_flattened() == other.triangles.as_flattened();
        std::ptr::eq(self, other) || self.positions.len() == other.positions.len() && has_same()
    }

    /// The first vertex whose position is not finite or beyond 1e15 m.
    pub(crate) fn unbounded_vertex(&self) -> Option<usize> {
        first_failing(&self.positions, |x| is_bounded(*x))
    }

    /// The first triangle with a vertex that does not exist, and that vertex.
    pub(crate) fn missing_vertex(&self) -> Option<(usize, u32)> {
        let corners = self.triangles.as_flattened();
        let place = first_failing(corners, |&vertex| (vertex as usize) < self.positions.len())?;
        Some((place / 3, corners[place]))
    }

    /// The lowest and highest corner of the bounding box (m).
    pub(crate) fn bounds(&self) -> [Vec3; 2] {
        bounds(&self.positions)
    }

    /// Distance (m) from a point to the nearest triangle.
    pub(crate) fn distance(&self, x: DVec3) -> f64 {
        let to = |triangle: &[u32; 3]| to_triangle(x, triangle.map(|vertex| self.positions[vertex as usize].as_dvec3()));
        self.triangles.iter().map(to).fold(f64::INFINITY, f64::min)
    }

    /// Each edge of the triangles once, as `[i, j]` with `i < j`, sorted. [`Options::edge_scale`](crate::Options::edge_scale)
    /// has a factor for each, in this order.
    #[must_use]
    pub fn edges(&self) -> Vec<[u32; 2]> {
        edges(&self.triangles)
    }

    /// The area (m²) that belongs to each vertex: a third of that of each of its triangles. A vertex without triangles
    /// has none.
    ///
    /// # Panics
    /// If a triangle has a vertex that does not exist.
    #[must_use]
    pub fn vertex_areas(&self) -> Vec<f64> {
        vertex_areas(&self.triangles, &self.positions)
    }
}

/// The first item that fails a test. A test of all is faster than a search for it, and in nearly all meshes none fails.
fn first_failing<T>(items: &[T], passes: impl Fn(&T) -> bool) -> Option<usize> {
    let all_pass = items.iter().fold(true, |all, item| all & passes(item));
    if all_pass { None } else { items.iter().position(|item| !passes(item)) }
}

/// See [`Mesh::vertex_areas`].
pub(crate) fn vertex_areas(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<f64> {
    let mut area = vec![0.0; positions.len()];
    for &triangle in triangles {
        triangle.iter().for_each(|&vertex| area[vertex as usize] += area_of(triangle, positions) / 3.0);
    }
    area
}

/// Area (m²), in double precision because single precision would lose a thin triangle.
pub(crate) fn area_of(triangle: [u32; 3], positions: &[Vec3]) -> f64 {
    let [a, b, c]: [DVec3; 3] = triangle.map(|vertex| positions[vertex as usize].as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

impl Recorded for Arc<Mesh> {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let mut mesh = Mesh::clone(self);
        mesh.positions.record(tape)?;
        mesh.triangles.record(tape)?;
        if let Tape::In(_) = tape {
            if mesh.missing_vertex().is_some() {
                return Err(Unreadable);
            }
            *self = Arc::new(mesh);
        }
        Ok(())
    }
}

/// The lowest and highest corner of the bounding box of some points; infinite in reverse if there are none.
pub(crate) fn bounds<V: Borrow<Vec3>>(points: impl IntoIterator<Item = V>) -> [Vec3; 2] {
    let points = points.into_iter().map(|x| *x.borrow());
    points.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
}

/// The box that a point covers on its way from `from` along `by` (m), enlarged on all sides.
pub(crate) fn around([from, by]: [Vec3; 2], enlargement: Vec3) -> [Vec3; 2] {
    [from.min(from + by) - enlargement, from.max(from + by) + enlargement]
}

/// Whether each vertex belongs to a triangle that may come within some bounds, given the boxes that the vertices are in. A triangle may
/// be larger than what is within the bounds, and have all its corners elsewhere.
pub(crate) fn near_vertices(triangles: &[[u32; 3]], boxes: impl Iterator<Item = [Vec3; 2]>, [low, high]: [Vec3; 2]) -> Vec<bool> {
    const IS_NEAR: u32 = 1 << 6;
    // The sides of the bounds that each vertex is beyond, one bit each. All corners of what is away are beyond one of them.
    let beyond = |[least, most]: [Vec3; 2]| least.cmpgt(high).bitmask() << 3 | most.cmplt(low).bitmask();
    let mut vertices: Vec<u32> = boxes.map(beyond).collect();
    for corners in triangles.iter().map(|corners| corners.map(|vertex| vertex as usize)) {
        if corners.iter().fold(!IS_NEAR, |all, &vertex| all & vertices[vertex]) == 0 {
            corners.iter().for_each(|&vertex| vertices[vertex] |= IS_NEAR);
        }
    }
    vertices.into_iter().map(|sides| sides & IS_NEAR != 0).collect()
}

/// The triangles at each of the edges, which are those of `index`.
pub(crate) fn triangles_at(edges: &[[u32; 2]], triangles: &[[u32; 3]], index: &EdgeIndex) -> Csr<u32> {
    let sides = (0..).zip(triangles).flat_map(|(triangle, &corners)| sides(corners).map(move |side| (side, triangle)));
    Csr::new(edges.len(), sides.map(|(side, triangle)| (index.of(side) as u32, triangle)))
}

/// Whether the corners of a triangle go around it from the first end of a side to the second.
pub(crate) fn follows([a, b, c]: [u32; 3], side: [u32; 2]) -> bool {
    [[a, b], [b, c], [c, a]].contains(&side)
}

/// The parameter, from 0 to 1, of the point of a segment that is nearest to `x`.
pub(crate) fn along(x: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    ((x - a).dot(b - a) / (b - a).length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}

/// Distance (m) from a point to a triangle: to its plane if the projection lies inside, else to the nearest side.
fn to_triangle(x: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let n = (b - a).cross(c - a);
    let is_over = |a: DVec3, b: DVec3| (b - a).cross(x - a).dot(n) >= 0.0;
    if n.length_squared() > 0.0 && is_over(a, b) && is_over(b, c) && is_over(c, a) {
        return (x - a).dot(n).abs() / n.length();
    }
    let to_side = |a: DVec3, b: DVec3| x.distance(a + (b - a) * along(x, [a, b]));
    to_side(a, b).min(to_side(b, c)).min(to_side(c, a))
}

/// Each edge of some triangles once, sorted.
pub(crate) fn edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    // Packed into one integer, edges sort faster than as pairs.
    let edges = triangles.iter().flat_map(|&triangle| sides(triangle)).map(|[i, j]| u64::from(i) << 32 | u64::from(j));
    distinct(edges.collect::<Vec<u64>>()).into_iter().map(|edge| [(edge >> 32) as u32, edge as u32]).collect()
}

/// For each vertex whether it has any of the edges.
pub(crate) fn has_edges(edges: &[[u32; 2]], vertices: usize) -> Vec<bool> {
    let mut has_edges = vec![false; vertices];
    edges.iter().flatten().for_each(|&vertex| has_edges[vertex as usize] = true);
    has_edges
}

/// Finds edges in a sorted list by their vertices.
pub(crate) struct EdgeIndex<'a> {
    edges: &'a [[u32; 2]],
    /// Where the edges of each first vertex begin.
    first: Vec<u32>,
}

impl<'a> EdgeIndex<'a> {
    pub(crate) fn new(edges: &'a [[u32; 2]], vertices: usize) -> EdgeIndex<'a> {
        let mut first = vec![0; vertices + 1];
        edges.iter().for_each(|edge| first[edge[0] as usize + 1] += 1);
        (0..vertices).for_each(|vertex| first[vertex + 1] += first[vertex]);
        EdgeIndex { edges, first }
    }

    /// The index of the edge `[i, j]`, which must be in the list.
    pub(crate) fn of(&self, [i, j]: [u32; 2]) -> usize {
        let start = self.first[i as usize] as usize;
        let near = &self.edges[start..self.first[i as usize + 1] as usize];
        start + near.partition_point(|edge| edge[1] < j)
    }
}

/// Whether a triangle has three corners; others are threads or points.
pub(crate) fn is_proper([a, b, c]: &[u32; 3]) -> bool {
    a != b && b != c && c != a
}

/// The edges of a triangle as `[i, j]` with `i < j`. Sides from a vertex to itself are omitted.
pub(crate) fn sides([a, b, c]: [u32; 3]) -> impl Iterator<Item = [u32; 2]> + Clone {
    [[a, b], [b, c], [c, a]].into_iter().filter(|[i, j]| i != j).map(|[i, j]| [i.min(j), i.max(j)])
}
