//! Edges in batches that share no vertex, and the one loop that relies on it.

use std::ops::Range;

use rayon::prelude::*;

use crate::kernels::Edge;

/// Edges a rayon task takes at a time: long enough (about 10 us) to pay for being stolen.
const GRAIN: usize = 1024;

/// Edges grouped into batches; within a batch no two edges share a vertex. Checked when made.
#[derive(Debug, Clone)]
pub(crate) struct Batches {
    edges: Vec<Edge>,
    ranges: Vec<Range<usize>>,
    vertices: usize,
}

impl Batches {
    /// Takes edges in batch order. `ranges` are the batches, each a range of `edges`.
    ///
    /// # Panics
    /// If an index is not below `vertices`, an edge joins a vertex to itself, or two edges of a batch share a vertex.
    pub(crate) fn new(edges: Vec<Edge>, ranges: Vec<Range<usize>>, vertices: usize) -> Batches {
        let mut seen = vec![usize::MAX; vertices];
        for (batch, range) in ranges.iter().enumerate() {
            for edge in &edges[range.clone()] {
                for vertex in [edge.a, edge.b] {
                    let mark = &mut seen[vertex as usize];
                    assert!(*mark != batch, "vertex {vertex} is in batch {batch} twice");
                    *mark = batch;
                }
            }
        }
        Batches { edges, ranges, vertices }
    }

    /// The edges, batch after batch.
    #[cfg(feature = "gpu")]
    pub(crate) fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Calls `f(edge, item of its first end, item of its second end)` for every edge, batch after batch; the edges of a
    /// batch in parallel, which gives the same bits on any number of threads.
    #[expect(unsafe_code, reason = "disjoint pairs of one slice: safe because `new` checked the batches, see below")]
    pub(crate) fn for_each<T: Send>(&self, items: &mut [T], f: impl Fn(&Edge, &mut T, &mut T) + Sync) {
        assert_eq!(items.len(), self.vertices, "one item per vertex");
        let items = Shared(items.as_mut_ptr());
        let items = &items;
        let visit = |edge: &Edge| {
            // SAFETY: `new` checked that both indices are below `vertices`, which is the slice's length, that they
            // differ, and that no other edge of this batch has either. Batches run one after another, and `for_each`
            // holds the only reference to the slice. So no two live references made here name the same item.
            let (a, b) = unsafe { (&mut *items.0.add(edge.a as usize), &mut *items.0.add(edge.b as usize)) };
            f(edge, a, b);
        };
        for range in &self.ranges {
            let batch = &self.edges[range.clone()];
            if batch.len() < 2 * GRAIN {
                batch.iter().for_each(visit);
            } else {
                batch.par_iter().with_min_len(GRAIN).for_each(visit);
            }
        }
    }
}

/// A pointer that tasks may share; [`Batches::for_each`] keeps their items apart.
struct Shared<T>(*mut T);

#[expect(unsafe_code, reason = "see Batches::for_each")]
// SAFETY: only `Batches::for_each` makes one, and there no item is reached from two tasks.
unsafe impl<T: Send> Sync for Shared<T> {}
