//! The correction by coarse levels: restrict, sweep each level, prolong. The theory is in `multigrid/hierarchy.rs`.

use std::ops::Range;

use glam::Vec4;

use crate::cpu::edge_batches::EdgeBatches;
use crate::cpu::partition::{Partition, Piece};
use crate::cpu::sweep::{Rule, sweep};
use crate::cpu::tasks::shared::lists::Indices;
use crate::cpu::tasks::shared::vectors::Four;
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::kernels::distance::Edge;
use crate::multigrid::hierarchy::{Level, MAX_LEVELS};
use crate::simd::aligned::AlignedVec;
use crate::simd::{self, Loop, Registers, Width};

/// Minimum and maximum number of aggregates per restriction task.
const GRAIN: [usize; 2] = [16, 64];
/// A level with fewer aggregates is swept by one task: waiting for one another would cost threads more than they save.
const WORTHWHILE: usize = 2048;
/// Marks a group of items that belong to more than one aggregate.
const MIXED: u32 = u32::MAX;

/// The coarse levels in use, packed for the CPU, finest first; empty without levels.
#[derive(Debug, Default)]
pub(crate) struct Coarse {
    levels: Vec<Aggregates>,
    states: Vec<State>,
}

/// The aggregates of one level.
#[derive(Debug)]
struct Aggregates {
    members: Members,
    /// The aggregate of each item of the next finer level.
    label: Indices,
    /// For each register's worth of items, the aggregate that all of them belong to, or [`MIXED`].
    common: Vec<u32>,
    inverse_mass: Vec<f32>,
    /// Aggregates per restriction task.
    grain: usize,
    partition: Partition,
    /// The packed edges of each round of the partition.
    edges: Vec<EdgeBatches>,
}

/// The state of a level's aggregates within a substep.
#[derive(Debug)]
struct State {
    /// Centers of mass (m), w the inverse mass (1/kg).
    x: AlignedVec,
    /// Displacement (m): first the restricted one, and after the level's sweep the correction. The w component has no
    /// meaning.
    change: AlignedVec,
    /// Displacement (m) after the corrections.
    u: AlignedVec,
}

/// The members of each aggregate, ascending, padded to whole registers by repeating the first with a mass share of 0;
/// and each member's share of the aggregate's mass.
#[derive(Debug)]
struct Members {
    items: Indices,
    shares: Vec<f32>,
    /// Where the members of each aggregate begin, and at the end the total.
    starts: Vec<usize>,
}

impl Members {
    fn new(level: &Level, lanes: usize) -> Members {
        let mut members = Members { items: Indices::new(level.label.len()), shares: Vec::new(), starts: vec![0] };
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
    fn chunk(&self, chunk: usize) -> Range<usize> {
        chunk * self.grain..((chunk + 1) * self.grain).min(self.inverse_mass.len())
    }

    /// Whether the sweep of this level is divided into tasks.
    fn is_shared(&self) -> bool {
        self.partition.tiles.len() > 1
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
                self.states.push(State { x: zero.clone(), change: zero.clone(), u: zero });
            }
            self.levels[index].pack(level, edges, width);
        }
    }

    /// Discards all levels.
    pub(crate) fn forget(&mut self) {
        *self = Coarse::default();
    }

    /// The number of levels in use.
    pub(crate) fn len(&self) -> usize {
        self.levels.len()
    }

    /// The number of levels whose sweeps are divided into tasks. They are the finest ones.
    pub(crate) fn shared(&self) -> usize {
        self.levels.iter().take_while(|level| level.is_shared()).count()
    }

    /// The partition of a level's sweep.
    pub(crate) fn partition(&self, level: usize) -> &Partition {
        &self.levels[level].partition
    }

    /// The number of restriction tasks of a level.
    pub(crate) fn restrictions(&self, level: usize) -> usize {
        self.levels[level].inverse_mass.len().div_ceil(self.levels[level].grain)
    }

    /// The aggregates of one restriction task.
    pub(crate) fn restricted(&self, level: usize, chunk: usize) -> Range<usize> {
        self.levels[level].chunk(chunk)
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

    /// Prepares the correction of displacements `u`, predicted from positions `x`, with edges corrected by `rule`.
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

/// The coarse correction during a step.
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

    /// Restricts to some aggregates of a level, those of one task.
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

    /// All work of the levels too small to divide, from `first` on: restricts to them (the finest level of all has
    /// restriction tasks of its own) and sweeps them, coarsest first.
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

    /// Sweeps a piece of a level. In the first round, the corrections of the coarser levels are prolonged to it before.
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

    /// Prolongs the correction of the finest level to a tile's vertices.
    pub(crate) fn correct(&self, task: &Task, tile: Range<u32>) {
        self.hand_down(task, 0, self.fine.1.within(task), tile);
    }

    fn hand_down(&self, task: &Task, level: usize, u: View<'_>, items: Range<u32>) {
        let (Aggregates { label, common, .. }, items) = (&self.levels[level], items.start as usize..items.end as usize);
        simd::run(self.width, HandDown { label, common, change: self.arrays(level).change.within(task), u, items });
    }
}

/// Mass-weighted averages of the members. Positions are averaged relative to the first member, so that the rounding
/// error is in proportion to the aggregate's size, not to its distance from the origin.
struct Restrict<'t> {
    members: &'t Members,
    inverse_mass: &'t [f32],
    /// Positions of the members; below, their displacements.
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

/// Prolongation: adds to each item the correction of its aggregate.
struct HandDown<'t> {
    label: &'t Indices,
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
        // Tiles begin at a multiple of the SIMD width; a remainder at the end is handled item by item.
        let rest = items.end - items.len() % L::LANES;
        let mut first = items.start;
        for common in common[items.start / L::VECTORS..rest / L::VECTORS].chunks_exact(4) {
            let row = u.row::<L>(first as u32);
            for (k, &of) in common.iter().enumerate() {
                // Most consecutive items belong to one aggregate.
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
