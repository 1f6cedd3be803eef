//! Triangle meshes: the shape the cloth is cut from.

use glam::Vec3;

/// A triangle mesh: vertex positions (m) and vertex indices, three a triangle.
///
/// Any triangles will do: open or closed, several pieces, edges with three or more triangles, vertices that no triangle
/// uses. A triangle that names a vertex twice is an edge without area: a thread.
/// [`Deformer::new`](crate::Deformer::new) checks indices and positions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Positions (m), one per vertex.
    pub positions: Vec<Vec3>,
    /// Vertex indices of each triangle, counter-clockwise seen from its front.
    pub triangles: Vec<[u32; 3]>,
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

    /// Each edge of the triangles once, as `[i, j]` with `i < j`, sorted. Length: the number of edges.
    #[must_use]
    pub fn edges(&self) -> Vec<[u32; 2]> {
        edges(&self.triangles)
    }
}

/// Each side of some triangles once, sorted.
pub(crate) fn edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    // One number is compared faster than two.
    let mut edges: Vec<u64> =
        triangles.iter().flat_map(|&triangle| sides(triangle)).map(|[i, j]| u64::from(i) << 32 | u64::from(j)).collect();
    edges.sort_unstable();
    edges.dedup();
    edges.into_iter().map(|edge| [(edge >> 32) as u32, edge as u32]).collect()
}

/// Finds edges in a sorted list of them.
pub(crate) struct EdgeIndex<'a> {
    edges: &'a [[u32; 2]],
    /// Where those of each first vertex start.
    first: Vec<u32>,
}

impl<'a> EdgeIndex<'a> {
    pub(crate) fn new(edges: &'a [[u32; 2]], vertices: usize) -> EdgeIndex<'a> {
        let mut first = vec![0; vertices + 1];
        edges.iter().for_each(|edge| first[edge[0] as usize + 1] += 1);
        (0..vertices).for_each(|vertex| first[vertex + 1] += first[vertex]);
        EdgeIndex { edges, first }
    }

    /// The index of `[i, j]`, which is in the list.
    pub(crate) fn of(&self, [i, j]: [u32; 2]) -> usize {
        let start = self.first[i as usize] as usize;
        let near = &self.edges[start..self.first[i as usize + 1] as usize];
        start + near.partition_point(|edge| edge[1] < j)
    }
}

/// The sides of a triangle as `[i, j]` with `i < j`; a side from a vertex to itself is none.
pub(crate) fn sides([a, b, c]: [u32; 3]) -> impl Iterator<Item = [u32; 2]> {
    [[a, b], [b, c], [c, a]].into_iter().filter(|[i, j]| i != j).map(|[i, j]| [i.min(j), i.max(j)])
}
