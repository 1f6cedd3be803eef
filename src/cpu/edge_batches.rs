//! The edges of a partition's pieces, packed for lanes that share no vertex: rows first, which need no gathering.
//!
//! What an edge is corrected by does not depend on the lane that it is in, so that any packing gives the same bits.

use std::ops::Range;

use crate::cpu::partition::Piece;
use crate::cpu::tasks::shared::lists::{Places, Rows};
use crate::kernels::distance::Edge;
use crate::simd::aligned::AlignedVec;
use crate::simd::{MAX_LANES, vector_of_lane};

/// How the vertices of a row's edges lie in memory; most of a grid's are side by side, which need no gathering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Ends {
    /// From vertices `a`, `a + 1` ... to `b`, `b + 1` ...: two ends are stored.
    Rows,
    /// From `a` to `a + 1`, from `a + 2` to `a + 3` ...: one end is stored.
    Pairs,
    /// Anywhere: an end for each lane, and once more.
    Listed,
}

/// Rows whose ends lie alike, one after another.
#[derive(Debug, Clone)]
struct RowsAlike {
    ends: Ends,
    rows: Range<usize>,
    /// Where their ends begin in the list of those that lie so.
    first: usize,
}

/// Rows whose ends lie alike, as the sweep takes them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Batch<'a> {
    pub ends: Ends,
    /// Lane by lane: one over the rest length (1/m), and what share of the correction each end takes, which is the edge's
    /// `inverse_weight` times the end's inverse mass.
    pub factors: &'a [f32],
    /// Where their ends are, from `first` on in the list of those that lie so.
    pub at: &'a EndLists,
    pub first: usize,
}

/// Where the ends of rows are.
#[derive(Debug, Default)]
pub(crate) struct EndLists {
    /// Of [`Ends::Rows`] the first vertices of both, of [`Ends::Pairs`] the first, of [`Ends::Listed`] all.
    pub rows: Rows,
    pub pairs: Rows,
    pub listed: Places,
}

/// The rows of a list of pieces: as many edges of one color as the processor takes together. A lane without an edge of its own
/// repeats another, in the same row to the same effect, else with no share.
#[derive(Debug, Default)]
pub(crate) struct EdgeBatches {
    lanes: usize,
    /// What [`Batch::factors`] are slices of.
    factors: AlignedVec,
    /// Lane by lane, the place of the edge whose factors those are; [`NO_SHARE`] more where it has no share.
    places: Vec<u32>,
    at: EndLists,
    batches: Vec<RowsAlike>,
    /// The batches of each piece.
    of: Vec<Range<usize>>,
}

/// An edge with its place in the list that it is from.
type Placed = (u32, Edge);

/// An edge, and whether it counts.
type Lane = (Placed, bool);

/// Added to the place of an edge that another lane has.
const NO_SHARE: u32 = 1 << 31;

impl Ends {
    /// End 0 or 1 of a lane's edge.
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
    /// Packs the edges of `pieces`, which are places in `edges`, color by color, for so many lanes, given the vertices' inverse
    /// masses.
    ///
    /// # Panics
    /// If an edge's vertex has no inverse mass, or a color names a vertex twice.
    pub(crate) fn new(
        pieces: &[Piece],
        edges: &[Edge],
        colors: &[Range<usize>],
        inverse_mass: &[f32],
        lanes: usize,
    ) -> EdgeBatches {
        let vertices = inverse_mass.len();
        let at = EndLists {
            rows: Rows::new(lanes, vertices.next_multiple_of(MAX_LANES)),
            pairs: Rows::new(2 * lanes, vertices.next_multiple_of(MAX_LANES)),
            listed: Places::new(vertices),
        };
        let batches = EdgeBatches { lanes, at, ..EdgeBatches::default() };
        let mut packer = Packer { inverse_mass, batches };
        // The piece and color that last visited a vertex.
        let mut visited = vec![[u32::MAX; 2]; vertices];
        let mut edges_now: Vec<Placed> = Vec::new();
        for (index, piece) in pieces.iter().enumerate() {
            let start = packer.batches.batches.len();
            // Springs are forces: no edge is swept.
            let mut rest = if edges.is_empty() { &[] } else { piece.edges.as_slice() };
            // Of a fan's many colors a piece has few.
            while let Some(&next) = rest.first() {
                let color = colors.partition_point(|range| range.end <= next as usize);
                let (now, later) = rest.split_at(rest.partition_point(|&place| (place as usize) < colors[color].end));
                rest = later;
                edges_now.clear();
                edges_now.extend(now.iter().map(|&place| (place, edges[place as usize])));
                for end in edges_now.iter().flat_map(|(_, edge)| [edge.a, edge.b]) {
                    let now = [index as u32, color as u32];
                    let before = std::mem::replace(&mut visited[end as usize], now);
                    assert!(before != now, "vertex {end} has two edges of a color");
                }
                packer.color(&mut edges_now, start);
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

    /// Takes the same edges for substeps of another length.
    pub(crate) fn reweigh(&mut self, edges: &[Edge], inverse_mass: &[f32]) {
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
    pub(crate) fn of(&self, piece: usize) -> impl Iterator<Item = Batch<'_>> {
        let row = 3 * self.lanes;
        self.batches[self.of[piece].clone()].iter().map(move |batch| Batch {
            ends: batch.ends,
            factors: &bytemuck::cast_slice(&self.factors)[row * batch.rows.start..row * batch.rows.end],
            at: &self.at,
            first: batch.first,
        })
    }
}

/// What share of the correction each end of an edge takes.
fn shares(edge: &Edge, counts: bool, inverse_mass: &[f32]) -> [f32; 2] {
    [edge.a, edge.b].map(|end| if counts { edge.inverse_weight * inverse_mass[end as usize] } else { 0.0 })
}

struct Packer<'a> {
    inverse_mass: &'a [f32],
    batches: EdgeBatches,
}

impl Packer<'_> {
    /// The edges of one color, which may come in any order: rows first, then what is left over. Batches from `open` on may grow.
    fn color(&mut self, edges: &mut [Placed], open: usize) {
        let lanes = self.batches.lanes;
        // Edges of one row have one offset, and come one after another.
        let offset = |(_, edge): &Placed| edge.b.wrapping_sub(edge.a);
        edges.sort_unstable_by_key(|edge| (offset(edge), edge.1.a));
        let step = |edge: &Placed| if offset(edge) == 1 { 2 } else { 1 };
        let follows = |one: &Placed, next: &Placed| offset(one) == offset(next) && next.1.a - one.1.a == step(one);
        let mut apart: Vec<Placed> = Vec::new();
        for run in edges.chunk_by(follows) {
            if run.len() < lanes {
                apart.extend(run);
                continue;
            }
            let ends = if step(&run[0]) == 1 { Ends::Rows } else { Ends::Pairs };
            for start in (0..run.len()).step_by(lanes) {
                // The last row of a run begins earlier, and leaves alone what the rows before have done.
                let first = start.min(run.len() - lanes);
                self.push(ends, open, |lane| {
                    let place = first + vector_of_lane(lane, lanes);
                    (run[place], place >= start)
                });
            }
        }
        apart.sort_unstable_by_key(|(_, edge)| (edge.a, edge.b));
        for edges in apart.chunks(lanes) {
            self.push(Ends::Listed, open, |lane| (edges[lane.min(edges.len() - 1)], true));
        }
    }

    /// Adds a row, given by its lanes, to the last batch of those from `open` on, or a new one.
    fn push(&mut self, ends: Ends, open: usize, lane: impl Fn(usize) -> Lane) {
        let EdgeBatches { lanes, factors, places, at, batches, .. } = &mut self.batches;
        let (lanes, row) = (*lanes, places.len() / *lanes);
        let edge = |k: usize| lane(k).0.1;
        let first = match ends {
            Ends::Rows => at.rows.len(),
            Ends::Pairs => at.pairs.len(),
            Ends::Listed => at.listed.len(),
        };
        match batches[open..].last_mut() {
            Some(batch) if batch.ends == ends => batch.rows.end += 1,
            _ => batches.push(RowsAlike { ends, rows: row..row + 1, first }),
        }
        match ends {
            Ends::Rows => [edge(0).a, edge(0).b].into_iter().for_each(|end| at.rows.push(end)),
            Ends::Pairs => at.pairs.push(edge(0).a),
            Ends::Listed => {
                at.listed.extend((0..lanes).map(|k| edge(k).a));
                at.listed.extend((0..lanes).map(|k| edge(k).b));
            }
        }
        let spelled = |k: usize| [0, 1].map(|end| ends.end(at, first, lanes, end, k));
        debug_assert!((0..lanes).all(|k| spelled(k) == [edge(k).a, edge(k).b]), "{ends:?}");
        let share = |k: usize, end: usize| shares(&edge(k), lane(k).1, self.inverse_mass)[end];
        factors.push(lanes, |k| edge(k).inverse_rest);
        factors.push(lanes, |k| share(k, 0));
        factors.push(lanes, |k| share(k, 1));
        if places.capacity() < places.len() + lanes {
            // Doubled, it would be the most that building takes, where a fan's rows have an edge each.
            places.reserve_exact(places.len() / 32 + 64 * lanes);
        }
        places.extend((0..lanes).map(|k| lane(k).0.0 | if lane(k).1 { 0 } else { NO_SHARE }));
    }
}
