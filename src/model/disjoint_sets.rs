//! Connected components of vertices (union-find).

/// Disjoint sets of vertices, each represented by its lowest vertex.
#[derive(Debug)]
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
