//! Which vertices belong together.

/// Disjoint sets of vertices, each named by its lowest.
#[derive(Debug)]
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// Of so many vertices, each alone.
    pub(crate) fn new(count: usize) -> DisjointSets {
        DisjointSets((0..count as u32).collect())
    }

    /// The lowest of the set that a vertex is in.
    pub(crate) fn root(&mut self, mut vertex: u32) -> u32 {
        while self.0[vertex as usize] != vertex {
            self.0[vertex as usize] = self.0[self.0[vertex as usize] as usize];
            vertex = self.0[vertex as usize];
        }
        vertex
    }

    /// Makes one set of those that two vertices are in.
    pub(crate) fn join(&mut self, ends: [u32; 2]) {
        let [a, b] = ends.map(|end| self.root(end));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
