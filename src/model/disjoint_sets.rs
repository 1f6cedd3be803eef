//! Connected components of vertices (union-find).

use crate::model::link::Link;

/// Disjoint sets of vertices, each represented by its lowest vertex.
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// `count` vertices, each in a set of its own.
    pub(crate) fn new(count: usize) -> DisjointSets {
        DisjointSets((0..count as u32).collect())
    }

    /// The connected part of each vertex, named by its lowest vertex.
    pub(crate) fn parts(count: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Vec<u32> {
        let mut sets = DisjointSets::new(count);
        pairs.for_each(|pair| sets.join(pair));
        (0..count as u32).map(|vertex| sets.root(vertex)).collect()
    }

    /// The part of each vertex that edges of the cloth connect.
    pub(crate) fn parts_of_links(count: usize, links: &[Link]) -> Vec<u32> {
        DisjointSets::parts(count, links.iter().map(|link| link.ends))
    }

    /// The part of each vertex that triangles connect.
    pub(crate) fn parts_of_triangles(count: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
        DisjointSets::parts(count, triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c]]))
    }

    /// The lowest vertex of the set that contains `vertex`.
    pub(crate) fn root(&mut self, mut vertex: u32) -> u32 {
        while self.0[vertex as usize] != vertex {
            self.0[vertex as usize] = self.0[self.0[vertex as usize] as usize];
            vertex = self.0[vertex as usize];
        }
        vertex
    }

    /// Merges the sets of two vertices.
    pub(crate) fn join(&mut self, ends: [u32; 2]) {
        let [a, b] = ends.map(|end| self.root(end));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
