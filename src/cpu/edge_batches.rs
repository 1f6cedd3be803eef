//! The edges of a partition's pieces, packed into rows: as many edges of one color as there are SIMD lanes, no two of
//! which share a vertex. Edges whose vertices are contiguous in memory come first; they need no gather.
//!
//! The correction of an edge does not depend on its lane, so any packing gives the same bits.

use std::ops::Range;

use crate::cpu::partition::Piece;
use crate::cpu::tasks::shared::lists::Indices;
use crate::kernels::distance::Edge;
use crate::model::csr::distinct;
use crate::simd::aligned::AlignedVec;
use crate::simd::{MAX_LANES, vector_of_lane};

/// How the vertices of a row's edges lie in memory. On a grid most of them are contiguous and need no gather.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Ends {
    /// Lane `k` holds the edge from `a + k` to `b + k`. Two vertices are stored.
    Rows,
    /// Lane `k` holds the edge from `a + 2k` to `a + 2k + 1`. One vertex is stored.
    Pairs,
    /// Both vertices of each lane are stored.
    Listed,
}

/// Consecutive rows with the same layout.
#[derive(Debug, Clone)]
struct RowRange {
    ends: Ends,
    rows: Range<usize>,
    /// Where their vertices begin in the list for this layout.
    first: usize,
}

/// Consecutive rows with the same layout, as the sweep processes them.
pub(crate) struct EdgeBatch<'a> {
    pub ends: Ends,
    /// For each row, one value per lane: the inverse rest length (1/m), then for each end the edge's `inverse_weight`
    /// times that end's inverse mass, which is its share of the correction.
    pub factors: &'a [f32],
    /// The lists of vertices. Those of this batch begin at `first` in the list for its layout.
    pub at: &'a EndLists,
    pub first: usize,
}

/// The vertices of all rows, a list for each layout.
#[derive(Debug, Default)]
pub(crate) struct EndLists {
    /// For [`Ends::Rows`], the first vertex of both ends.
    pub rows: Indices,
    /// For [`Ends::Pairs`], the first vertex.
    pub pairs: Indices,
    /// For [`Ends::Listed`], all vertices.
    pub listed: Indices,
}

/// The packed rows of a list of pieces. A lane without an edge of its own repeats another: within the same row this has
/// no effect on the result; an edge that an earlier row already corrected gets a share of 0.
#[derive(Debug, Default)]
pub(crate) struct EdgeBatches {
    lanes: usize,
    /// The values that [`EdgeBatch::factors`] are slices of.
    factors: AlignedVec,
    /// For each lane of each row, the index of its edge. [`NO_SHARE`] is added where the lane has no share.
    places: Vec<u32>,
    at: EndLists,
    batches: Vec<RowRange>,
    /// The range of batches of each piece.
    of: Vec<Range<usize>>,
}

/// A lane of a row: the index of its edge in the color order, and whether it applies that edge's correction.
struct Lane {
    index: u32,
    corrects: bool,
}

/// Bit that marks a lane whose edge another row corrects.
const NO_SHARE: u32 = 1 << 31;

impl Ends {
    /// The vertex at end 0 or 1 of a lane's edge.
    fn end(self, at: &EndLists, first: usize, lanes: usize, end: usize, lane: usize) -> u32 {
        let vector = vector_of_lane(lane, lanes) as u32;
        match self {
            Ends::Rows => at.rows.of(first + end) + vector,
            Ends::Pairs => at.pairs.of(first) + 2 * vector + end as u32,
            Ends::Listed => at.listed.of(first + end * lanes + lane),
        }
    }
}

impl EdgeBatches {
    /// Packs the edges of `pieces`, which are indices into `edges`, color by color for the given number of lanes.
    /// `colors` are the ranges of each color, `inverse_mass` has a value per vertex.
    ///
    /// # Panics
    /// If a vertex has no inverse mass, or two edges of one color share a vertex.
    pub(crate) fn new(
        pieces: &[Piece],
        edges: &[Edge],
        colors: &[Range<usize>],
        inverse_mass: &[f32],
        lanes: usize,
    ) -> EdgeBatches {
        let vertices = inverse_mass.len();
        let at = EndLists {
            rows: Indices::of_rows(lanes, vertices.next_multiple_of(MAX_LANES)),
            pairs: Indices::of_rows(2 * lanes, vertices.next_multiple_of(MAX_LANES)),
            listed: Indices::new(vertices),
        };
        let batches = EdgeBatches { lanes, at, ..EdgeBatches::default() };
        let mut packer = Packer { edges, inverse_mass, batches };
        // The piece and the color that last visited each vertex.
        let mut visited = vec![[usize::MAX; 2]; vertices];
        for (index, piece) in pieces.iter().enumerate() {
            let start = packer.batches.batches.len();
            // With springs no edge is swept.
            let mut rest = if edges.is_empty() { &[] } else { piece.edges.as_slice() };
            // Look up the color of the next edge rather than looping over all colors: a triangle fan has many colors,
            // of which a piece has few.
            while let Some(&next) = rest.first() {
                let color = &colors[colors.partition_point(|range| range.end <= next as usize)];
                let end = rest.iter().position(|&place| !color.contains(&(place as usize)));
                let (now, later) = rest.split_at(end.unwrap_or(rest.len()));
                rest = later;
                for end in now.iter().flat_map(|&place| [edges[place as usize].a, edges[place as usize].b]) {
                    let now = [index, color.start];
                    let before = std::mem::replace(&mut visited[end as usize], now);
                    assert!(before != now, "vertex {end} has two edges of a color");
                }
                packer.color(now, start);
            }
            let end = packer.batches.batches.len();
            packer.batches.of.push(start..end);
        }
        packer.batches.factors.trim();
        packer.batches.places.shrink_to_fit();
        packer.batches.at.rows.trim();
        packer.batches.at.pairs.trim();
        packer.batches.at.listed.trim();
        packer.batches
    }

    /// Recomputes the shares for substeps of another length; the packing stays.
    pub(crate) fn update_shares(&mut self, edges: &[Edge], inverse_mass: &[f32]) {
        let factors: &mut [f32] = bytemuck::cast_slice_mut(&mut self.factors);
        for (row, places) in factors.chunks_exact_mut(3 * self.lanes).zip(self.places.chunks_exact(self.lanes)) {
            for (lane, &place) in places.iter().enumerate() {
                let counts = place < NO_SHARE;
                let edge = &edges[(place & !NO_SHARE) as usize];
                [row[self.lanes + lane], row[2 * self.lanes + lane]] = shares(edge, counts, inverse_mass);
            }
        }
    }

    /// The batches of one piece, in order.
    pub(crate) fn of(&self, piece: usize) -> impl Iterator<Item = EdgeBatch<'_>> {
        let row = 3 * self.lanes;
        self.batches[self.of[piece].clone()].iter().map(move |batch| EdgeBatch {
            ends: batch.ends,
            factors: &bytemuck::cast_slice(&self.factors)[row * batch.rows.start..row * batch.rows.end],
            at: &self.at,
            first: batch.first,
        })
    }
}

/// The share of the correction that each end of an edge takes.
fn shares(edge: &Edge, counts: bool, inverse_mass: &[f32]) -> [f32; 2] {
    [edge.a, edge.b].map(|end| if counts { edge.inverse_weight * inverse_mass[end as usize] } else { 0.0 })
}

struct Packer<'a> {
    edges: &'a [Edge],
    inverse_mass: &'a [f32],
    batches: EdgeBatches,
}

impl Packer<'_> {
    /// Packs the edges of one color, given by their indices in any order: contiguous rows first, then the rest. Rows may be
    /// appended to a batch from number `open` on.
    fn color(&mut self, indices: &[u32], open: usize) {
        let lanes = self.batches.lanes;
        // Edges of a contiguous row have the same vertex offset and consecutive first vertices.
        let placed = |&index: &u32| {
            let Edge { a, b, .. } = self.edges[index as usize];
            [b.wrapping_sub(a), a, index]
        };
        let step = |offset: u32| if offset == 1 { 2 } else { 1 };
        let follows = |one: &[u32; 3], next: &[u32; 3]| one[0] == next[0] && next[1] - one[1] == step(one[0]);
        let mut apart: Vec<[u32; 2]> = Vec::new();
        for run in distinct(indices.iter().map(placed).collect()).chunk_by(follows) {
            if run.len() < lanes {
                apart.extend(run.iter().map(|&[_, a, index]| [a, index]));
                continue;
            }
            let ends = if step(run[0][0]) == 1 { Ends::Rows } else { Ends::Pairs };
            for start in (0..run.len()).step_by(lanes) {
                // The last row of a run overlaps the row before so that it is full; edges already corrected there get
                // no share.
                let first = start.min(run.len() - lanes);
                self.push(ends, open, |lane| {
                    let place = first + vector_of_lane(lane, lanes);
                    Lane { index: run[place][2], corrects: place >= start }
                });
            }
        }
        for edges in distinct(apart).chunks(lanes) {
            self.push(Ends::Listed, open, |lane| Lane { index: edges[lane.min(edges.len() - 1)][1], corrects: true });
        }
    }

    /// Appends a row, given by its lanes, to the last batch from number `open` on if that has the same layout, else to
    /// a new one.
    fn push(&mut self, ends: Ends, open: usize, lane: impl Fn(usize) -> Lane) {
        let EdgeBatches { lanes, factors, places, at, batches, .. } = &mut self.batches;
        let (lanes, row) = (*lanes, places.len() / *lanes);
        let edge = |k: usize| &self.edges[lane(k).index as usize];
        let first = match ends {
            Ends::Rows => at.rows.len(),
            Ends::Pairs => at.pairs.len(),
            Ends::Listed => at.listed.len(),
        };
        match batches[open..].last_mut() {
            Some(batch) if batch.ends == ends => batch.rows.end += 1,
            _ => batches.push(RowRange { ends, rows: row..row + 1, first }),
        }
        match ends {
            Ends::Rows => at.rows.extend([edge(0).a, edge(0).b]),
            Ends::Pairs => at.pairs.extend([edge(0).a]),
            Ends::Listed => {
                at.listed.extend((0..lanes).map(|k| edge(k).a));
                at.listed.extend((0..lanes).map(|k| edge(k).b));
            }
        }
        let spelled = |k: usize| [0, 1].map(|end| ends.end(at, first, lanes, end, k));
        debug_assert!((0..lanes).all(|k| spelled(k) == [edge(k).a, edge(k).b]), "{ends:?}");
        let share = |k: usize, end: usize| shares(edge(k), lane(k).corrects, self.inverse_mass)[end];
        factors.push(lanes, |k| edge(k).inverse_rest);
        factors.push(lanes, |k| share(k, 0));
        factors.push(lanes, |k| share(k, 1));
        if places.capacity() < places.len() + lanes {
            // Grown in small increments: on a triangle fan, whose rows have one edge each, doubling would set the peak
            // memory of building.
            places.reserve_exact(places.len() / 32 + 64 * lanes);
        }
        let marked = |Lane { index, corrects }: Lane| index | if corrects { 0 } else { NO_SHARE };
        places.extend((0..lanes).map(|k| marked(lane(k))));
    }
}
