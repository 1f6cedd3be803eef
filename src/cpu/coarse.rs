//! The coarse levels as the CPU stores them, packed for SIMD; [`correction`](super::correction) runs them.

use std::ops::Range;

use crate::cpu::edge_batches::EdgeBatches;
use crate::cpu::partition::{Partition, Piece};
use crate::cpu::tasks::shared::lists::Indices;
use crate::kernels::distance::Edge;
use crate::multigrid::hierarchy::Level;
use crate::simd::Width;
use crate::simd::aligned::AlignedVec;

/// Minimum and maximum number of aggregates per restriction task.
const GRAIN: [usize; 2] = [16, 64];
/// A level with fewer aggregates is swept by one task: waiting for one another would cost threads more than they save.
const WORTHWHILE: usize = 2048;
/// Marks a group of items that belong to more than one aggregate.
pub(super) const MIXED: u32 = u32::MAX;

/// The coarse levels in use, packed for the CPU, finest first; empty without levels.
#[derive(Default)]
pub(crate) struct Coarse {
    pub(super) levels: Vec<Aggregates>,
    pub(super) states: Vec<AggregateState<AlignedVec>>,
}

/// The aggregates of one level.
pub(super) struct Aggregates {
    pub members: Members,
    /// The aggregate of each item of the next finer level.
    pub label: Indices,
    /// For each register's worth of items, the aggregate that all of them belong to, or [`MIXED`].
    pub common: Vec<u32>,
    pub inverse_mass: Vec<f32>,
    /// Aggregates per restriction task.
    grain: usize,
    pub partition: Partition,
    /// The packed edges of each round of the partition.
    pub edges: Vec<EdgeBatches>,
    /// [`Level::sweeps`]; more than one only of a level that one task sweeps.
    pub sweeps: u32,
}

/// The state of a level's aggregates within a substep, in lists `T`.
pub(super) struct AggregateState<T> {
    /// Centers of mass (m), w the inverse mass (1/kg).
    pub x: T,
    /// Displacement (m): first the restricted one, and after the level's sweep the correction. The w component has no
    /// meaning.
    pub change: T,
    /// Displacement (m) after the corrections.
    pub u: T,
}

/// The members of each aggregate, ascending, padded to whole registers by repeating the first with a mass share of 0;
/// and each member's share of the aggregate's mass.
pub(super) struct Members {
    pub items: Indices,
    pub shares: Vec<f32>,
    /// Where the members of each aggregate begin, and at the end the total.
    pub starts: Vec<usize>,
}

impl Members {
    fn new(level: &Level, lanes: usize) -> Members {
        let mut members = Members { items: Indices::new(level.label.len()), shares: Vec::new(), starts: vec![0] };
        for span in &level.members.spans {
            let range = span.range();
            let first = level.members.items[range.start];
            let whole = range.len().next_multiple_of(lanes / 4);
            let repeated = std::iter::repeat_n(first, whole - range.len());
            members.items.extend(level.members.items[range.clone()].iter().copied().chain(repeated));
            members.shares.extend(&level.share[range]);
            members.shares.resize(members.items.len(), 0.0);
            members.starts.push(members.items.len());
        }
        members
    }
}

/// The label that all items have, or [`MIXED`].
fn common(labels: &[u32]) -> u32 {
    if labels.iter().all(|&label| label == labels[0]) { labels[0] } else { MIXED }
}

impl Aggregates {
    fn new(level: &Level, width: Width, threads: usize) -> Aggregates {
        let count = level.inverse_mass.len();
        let mut label = Indices::new(count);
        label.extend(level.label.iter().copied());
        Aggregates {
            members: Members::new(level, width.lanes()),
            label,
            common: level.label.chunks(width.lanes() / 4).map(common).collect(),
            inverse_mass: level.inverse_mass.clone(),
            grain: (count / (2 * threads)).clamp(GRAIN[0], GRAIN[1]),
            partition: Partition::coarse(&level.links, count, if count < WORTHWHILE { 1 } else { threads }),
            edges: Vec::new(),
            sweeps: level.sweeps,
        }
    }

    fn pack(&mut self, level: &Level, edges: &[Edge], width: Width) {
        if !self.edges.is_empty() {
            return self.edges.iter_mut().for_each(|round| round.update_shares(edges, &self.inverse_mass));
        }
        let pack = |pieces: &Vec<Piece>| EdgeBatches::new(pieces, edges, &level.colors, &level.inverse_mass, width.lanes());
        self.edges = self.partition.rounds.iter().map(pack).collect();
    }

    /// The aggregates of one restriction task.
    pub(super) fn chunk(&self, chunk: usize) -> Range<usize> {
        chunk * self.grain..((chunk + 1) * self.grain).min(self.inverse_mass.len())
    }
}

impl Coarse {
    /// Packs `edges`, those of each level in use, for substeps of another length.
    pub(crate) fn pack(&mut self, levels: &[Level], edges: &[Vec<Edge>], width: Width, threads: usize) {
        self.levels.truncate(edges.len());
        self.states.truncate(edges.len());
        for (index, (level, edges)) in levels.iter().zip(edges).enumerate() {
            if index == self.levels.len() {
                self.levels.push(Aggregates::new(level, width, threads));
                let zero = AlignedVec::new(level.inverse_mass.len());
                self.states.push(AggregateState { x: zero.clone(), change: zero.clone(), u: zero });
            }
            self.levels[index].pack(level, edges, width);
        }
    }

    /// The number of levels whose sweeps are divided into tasks. They are the finest ones.
    pub(crate) fn shared(&self) -> usize {
        self.levels.iter().take_while(|level| level.partition.tiles.len() > 1).count()
    }

    /// The aggregates of each restriction task of a level.
    pub(crate) fn restrictions(&self, level: usize) -> impl Iterator<Item = Range<usize>> {
        let level = &self.levels[level];
        (0..level.inverse_mass.len().div_ceil(level.grain)).map(|chunk| level.chunk(chunk))
    }

    /// The members of some aggregates, as items of the next finer level.
    pub(crate) fn members(&self, level: usize, aggregates: Range<usize>) -> impl Iterator<Item = u32> {
        let members = &self.levels[level].members;
        (members.starts[aggregates.start]..members.starts[aggregates.end]).map(|index| members.items.of(index))
    }

    /// The aggregates that some items of the next finer level belong to.
    pub(crate) fn labels(&self, level: usize, items: Range<u32>) -> impl Iterator<Item = u32> {
        items.map(move |item| self.levels[level].label.of(item as usize))
    }
}
