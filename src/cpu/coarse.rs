//! The correction by coarse levels: restrict, sweep each level, hand down. The theory is in `multigrid/hierarchy.rs`.

use std::ops::Range;

use glam::Vec4;

use crate::cpu::edge_batches::EdgeBatches;
use crate::cpu::partition::{Partition, Piece};
use crate::cpu::sweep::{Rule, sweep};
use crate::cpu::tasks::shared::lists::Places;
use crate::cpu::tasks::shared::vectors::Four;
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::kernels::distance::Edge;
use crate::multigrid::hierarchy::{Level, MAX_LEVELS};
use crate::simd::aligned::AlignedVec;
use crate::simd::{self, Loop, Registers, Width};

/// Aggregates that a task restricts, at least and at most.
const GRAIN: [usize; 2] = [16, 64];
/// Fewer aggregates than this are no work to share: to wait for one another would cost more.
const WORTHWHILE: usize = 2048;
/// No one aggregate.
const MIXED: u32 = u32::MAX;

/// The levels in use as the processor sweeps them, the finest first; nothing without levels.
#[derive(Debug, Default)]
pub(crate) struct Coarse {
    levels: Vec<Aggregates>,
    states: Vec<State>,
}

/// The aggregates of a level.
#[derive(Debug)]
struct Aggregates {
    members: Members,
    /// The aggregate of each item below; of as many items as a register holds, the one that they are all of, or [`MIXED`].
    label: Places,
    common: Vec<u32>,
    inverse_mass: Vec<f32>,
    /// Aggregates that a task restricts.
    grain: usize,
    partition: Partition,
    /// The edges of each round.
    edges: Vec<EdgeBatches>,
}

/// What a level's aggregates do in a substep.
#[derive(Debug)]
struct State {
    /// Centers (m), w the inverse mass (1/kg).
    x: AlignedVec,
    /// Their displacement (m): as predicted, and once it is done with, what it was corrected by. Its w means nothing.
    change: AlignedVec,
    /// As corrected.
    u: AlignedVec,
}

/// The items of each aggregate in whole registers, ascending, and their shares of its mass; the first comes again at the end, with
/// none.
#[derive(Debug)]
struct Members {
    items: Places,
    shares: Vec<f32>,
    /// Where each aggregate's begin, and the last one's end.
    starts: Vec<usize>,
}

impl Members {
    fn new(level: &Level, lanes: usize) -> Members {
        let mut members = Members { items: Places::new(level.label.len()), shares: Vec::new(), starts: vec![0] };
        for span in &level.members.spans {
            let range = span.start as usize..span.end as usize;
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

/// The label that all of these are.
fn common(labels: &[u32]) -> u32 {
    if labels.iter().all(|&label| label == labels[0]) { labels[0] } else { MIXED }
}

impl Aggregates {
    fn new(level: &Level, width: Width, threads: usize) -> Aggregates {
        let count = level.inverse_mass.len();
        let mut label = Places::new(count);
        label.extend(level.label.iter().copied());
        Aggregates {
            members: Members::new(level, width.lanes()),
            label,
            common: level.label.chunks(width.lanes() / 4).map(common).collect(),
            inverse_mass: level.inverse_mass.clone(),
            grain: (count / (2 * threads)).clamp(GRAIN[0], GRAIN[1]),
            partition: Partition::coarse(&level.links, count, if count < WORTHWHILE { 1 } else { threads }),
            edges: Vec::new(),
        }
    }

    fn pack(&mut self, level: &Level, edges: &[Edge], width: Width) {
        if !self.edges.is_empty() {
            return self.edges.iter_mut().for_each(|round| round.reweigh(edges, &self.inverse_mass));
        }
        let pack = |pieces: &Vec<Piece>| EdgeBatches::new(pieces, edges, &level.colors, &level.inverse_mass, width.lanes());
        self.edges = self.partition.rounds.iter().map(pack).collect();
    }

    /// The aggregates that a task restricts.
    fn chunk(&self, chunk: usize) -> Range<usize> {
        chunk * self.grain..((chunk + 1) * self.grain).min(self.inverse_mass.len())
    }

    /// Whether its sweep is tasks of its own.
    fn is_shared(&self) -> bool {
        self.partition.tiles.len() > 1
    }
}

impl Coarse {
    /// Makes ready for substeps of another length: `edges` of each level in use.
    pub(crate) fn pack(&mut self, levels: &[Level], edges: &[Vec<Edge>], width: Width, threads: usize) {
        self.levels.truncate(edges.len());
        self.states.truncate(edges.len());
        for (index, (level, edges)) in levels.iter().zip(edges).enumerate() {
            if index == self.levels.len() {
                self.levels.push(Aggregates::new(level, width, threads));
                let zero = AlignedVec::new(level.inverse_mass.len());
                self.states.push(State { x: zero.clone(), change: zero.clone(), u: zero });
            }
            self.levels[index].pack(level, edges, width);
        }
    }

    /// Forgets all levels.
    pub(crate) fn forget(&mut self) {
        *self = Coarse::default();
    }

    /// Levels in use.
    pub(crate) fn len(&self) -> usize {
        self.levels.len()
    }

    /// The finest levels, whose sweeps are tasks of their own.
    pub(crate) fn shared(&self) -> usize {
        self.levels.iter().take_while(|level| level.is_shared()).count()
    }

    /// How a level's sweep is cut.
    pub(crate) fn partition(&self, level: usize) -> &Partition {
        &self.levels[level].partition
    }

    /// Tasks of the restriction to a level.
    pub(crate) fn restrictions(&self, level: usize) -> usize {
        self.levels[level].inverse_mass.len().div_ceil(self.levels[level].grain)
    }

    /// The aggregates that a task restricts.
    pub(crate) fn restricted(&self, level: usize, chunk: usize) -> Range<usize> {
        self.levels[level].chunk(chunk)
    }

    /// The items below that some aggregates are made of.
    pub(crate) fn members(&self, level: usize, aggregates: Range<usize>) -> impl Iterator<Item = u32> {
        let members = &self.levels[level].members;
        (members.starts[aggregates.start]..members.starts[aggregates.end]).map(|index| members.items.of(index))
    }

    /// The aggregates of some items below.
    pub(crate) fn labels(&self, level: usize, items: Range<u32>) -> impl Iterator<Item = u32> {
        items.map(move |item| self.levels[level].label.of(item as usize))
    }

    /// The correction, by a rule, of displacements `u` that were predicted from `x`.
    pub(crate) fn share<'a>(
        &'a mut self,
        x: &'a SharedArray<'a>,
        u: &'a SharedArray<'a>,
        rule: Rule,
        width: Width,
    ) -> Correction<'a> {
        let mut states = self.states.iter_mut();
        let arrays = std::array::from_fn(|_| {
            let State { x, change, u } = states.next()?;
            Some(Arrays { x: SharedArray::new(x.room()), change: SharedArray::new(change.room()), u: SharedArray::new(u.room()) })
        });
        Correction { levels: &self.levels, fine: (x, u), arrays, rule, width }
    }
}

#[derive(Debug)]
struct Arrays<'a> {
    x: SharedArray<'a>,
    change: SharedArray<'a>,
    u: SharedArray<'a>,
}

/// A correction at work.
#[derive(Debug)]
pub(crate) struct Correction<'a> {
    levels: &'a [Aggregates],
    fine: (&'a SharedArray<'a>, &'a SharedArray<'a>),
    arrays: [Option<Arrays<'a>>; MAX_LEVELS],
    rule: Rule,
    width: Width,
}

impl Correction<'_> {
    fn arrays(&self, level: usize) -> &Arrays<'_> {
        self.arrays[level].as_ref().expect("a level in use has arrays")
    }

    /// Averages some aggregates of a level, a task's chunk, from what they are made of.
    pub(crate) fn restrict(&self, task: &Task, level: usize, chunk: usize) {
        self.average(task, level, self.levels[level].chunk(chunk));
    }

    fn average(&self, task: &Task, level: usize, aggregates: Range<usize>) {
        let (x, u) = match level {
            0 => self.fine,
            _ => (&self.arrays(level - 1).x, &self.arrays(level - 1).u),
        };
        let (to, here) = (self.arrays(level), &self.levels[level]);
        simd::run(
            self.width,
            Restrict {
                members: &here.members,
                inverse_mass: &here.inverse_mass,
                x: x.within(task),
                u: u.within(task),
                to_x: to.x.within(task),
                to_change: to.change.within(task),
                to_u: to.u.within(task),
                aggregates,
            },
        );
    }

    /// All that levels too small to share do, from `first` on: restricts them but the finest of all, and sweeps them.
    pub(crate) fn small_levels(&self, task: &Task, first: usize) {
        for level in first.max(1)..self.levels.len() {
            self.average(task, level, 0..self.levels[level].inverse_mass.len());
        }
        for level in (first..self.levels.len()).rev() {
            for round in 0..self.levels[level].edges.len() {
                (0..self.levels[level].partition.rounds[round].len()).for_each(|piece| self.sweep(task, level, round, piece));
            }
        }
    }

    /// Sweeps a piece of a level, after it was handed what the coarser ones were corrected by.
    pub(crate) fn sweep(&self, task: &Task, level: usize, round: usize, piece: usize) {
        let (here, arrays) = (&self.levels[level], self.arrays(level));
        let (x, change, u) = (arrays.x.within(task), arrays.change.within(task), arrays.u.within(task));
        if round == 0 && level + 1 < self.levels.len() {
            self.hand_down(task, level + 1, u, here.partition.tiles[piece].clone());
        }
        sweep(&here.edges[round], piece, self.rule, x, u, self.width);
        for vertex in here.partition.rounds[round][piece].vertices.iter().cloned().flatten() {
            change.set(vertex as usize, u.get(vertex as usize) - change.get(vertex as usize));
        }
    }

    /// Adds to a tile's vertices what their aggregates were corrected by.
    pub(crate) fn correct(&self, task: &Task, tile: Range<u32>) {
        self.hand_down(task, 0, self.fine.1.within(task), tile);
    }

    fn hand_down(&self, task: &Task, level: usize, u: View<'_>, items: Range<u32>) {
        let (Aggregates { label, common, .. }, items) = (&self.levels[level], items.start as usize..items.end as usize);
        simd::run(self.width, HandDown { label, common, change: self.arrays(level).change.within(task), u, items });
    }
}

/// Mass-weighted averages of the items below. Positions are taken relative to the first, which keeps what single
/// precision loses in proportion to the aggregate's size.
struct Restrict<'t> {
    members: &'t Members,
    inverse_mass: &'t [f32],
    /// Of the items.
    x: View<'t>,
    u: View<'t>,
    to_x: View<'t>,
    to_change: View<'t>,
    to_u: View<'t>,
    aggregates: Range<usize>,
}

impl Loop for Restrict<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Restrict { members, inverse_mass, to_x, to_change, to_u, aggregates, .. } = self;
        let (x, u) = (self.x.at(&members.items), self.u.at(&members.items));
        for aggregate in aggregates {
            let (start, end) = (members.starts[aggregate], members.starts[aggregate + 1]);
            let first = x.get(start);
            let (origin, mut dx, mut by) = (L::repeat(first), L::splat(0.0), L::splat(0.0));
            let mut at = start;
            for shares in members.shares[start..end].chunks_exact(L::VECTORS) {
                let share = L::repeat_each(shares);
                dx = (x.ascending::<L>(at) - origin).mul_add(share, dx);
                by = u.ascending::<L>(at).mul_add(share, by);
                at += L::VECTORS;
            }
            let by = by.sum();
            to_x.set(aggregate, (first + dx.sum()).truncate().extend(inverse_mass[aggregate]));
            to_change.set(aggregate, by);
            to_u.set(aggregate, by);
        }
    }
}

/// Adds to each item what its aggregate was corrected by.
struct HandDown<'t> {
    label: &'t Places,
    common: &'t [u32],
    change: View<'t>,
    u: View<'t>,
    items: Range<usize>,
}

impl Loop for HandDown<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let HandDown { label, common, change, u, items } = self;
        let by_label = change.at(label);
        // Items begin with a whole group of lanes.
        let rest = items.end - items.len() % L::LANES;
        let mut first = items.start;
        for common in common[items.start / L::VECTORS..rest / L::VECTORS].chunks_exact(4) {
            let row = u.row::<L>(first as u32);
            for (k, &of) in common.iter().enumerate() {
                // Neighbors are mostly of one aggregate.
                let by = match of {
                    MIXED => by_label.register::<L>(first + k * L::VECTORS),
                    of => L::repeat(change.get(of as usize)),
                };
                row.set(k, row.get(k) + by);
            }
            first += L::LANES;
        }
        for item in rest..items.end {
            let by: Vec4 = by_label.get(item);
            u.set(item, u.get(item) + by);
        }
    }
}
