//! The correction by coarse levels at work: restrict, sweep each level, prolongate. The theory is in
//! `multigrid/hierarchy.rs`, the levels as the CPU stores them in [`coarse`](super::coarse).

use std::ops::Range;

use glam::Vec4;

use crate::cpu::coarse::{AggregateState, Aggregates, Coarse, MIXED, Members};
use crate::cpu::sweep::{Rule, SweepRows};
use crate::cpu::tasks::shared::lists::Indices;
use crate::cpu::tasks::shared::vectors::Four;
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::multigrid::hierarchy::MAX_LEVELS;
use crate::simd::{self, Loop, Registers, Width};

/// The coarse correction during a step.
pub(crate) struct Correction<'a> {
    levels: &'a [Aggregates],
    /// Positions and displacements of the vertices.
    fine: (&'a SharedArray<'a>, &'a SharedArray<'a>),
    states: [Option<AggregateState<SharedArray<'a>>>; MAX_LEVELS],
    rule: Rule,
    width: Width,
}

impl<'a> Correction<'a> {
    /// The correction of displacements `u`, predicted from positions `x`, with edges corrected by `rule`.
    pub(crate) fn new(
        coarse: &'a mut Coarse,
        x: &'a SharedArray<'a>,
        u: &'a SharedArray<'a>,
        rule: Rule,
        width: Width,
    ) -> Correction<'a> {
        let mut lists = coarse.states.iter_mut();
        let states = std::array::from_fn(|_| {
            let AggregateState { x, change, u } = lists.next()?;
            let [x, change, u] = [x, change, u].map(|list| SharedArray::new(list.room()));
            Some(AggregateState { x, change, u })
        });
        Correction { levels: &coarse.levels, fine: (x, u), states, rule, width }
    }
}

impl Correction<'_> {
    fn state(&self, level: usize) -> &AggregateState<SharedArray<'_>> {
        self.states[level].as_ref().expect("a level in use has a state")
    }

    /// Restricts to some aggregates of a level, those of one task.
    pub(crate) fn restrict(&self, task: &Task, level: usize, chunk: usize) {
        self.average(task, level, self.levels[level].chunk(chunk));
    }

    fn average(&self, task: &Task, level: usize, aggregates: Range<usize>) {
        let (x, u) = match level {
            0 => self.fine,
            _ => (&self.state(level - 1).x, &self.state(level - 1).u),
        };
        let (to, Aggregates { members, inverse_mass, .. }) = (self.state(level), &self.levels[level]);
        let [x, u, to_x, to_change, to_u] = [x, u, &to.x, &to.change, &to.u].map(|list| list.within(task));
        simd::run(self.width, Restrict { members, inverse_mass, x, u, to_x, to_change, to_u, aggregates });
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

    /// Sweeps a piece of a level. In the first round, the corrections of the coarser levels are prolongated to it before.
    pub(crate) fn sweep(&self, task: &Task, level: usize, round: usize, piece: usize) {
        let (here, state) = (&self.levels[level], self.state(level));
        let (x, change, u) = (state.x.within(task), state.change.within(task), state.u.within(task));
        if round == 0 && level + 1 < self.levels.len() {
            self.prolongate(task, level + 1, u, here.partition.tiles[piece].clone());
        }
        let sweeps = if let Rule::ProjectCoarse { .. } = self.rule { here.sweeps } else { 1 };
        for _ in 0..sweeps {
            let rows = |batch| SweepRows { rule: self.rule, batch, x, u, predicted: change };
            here.edges[round].of(piece).for_each(|batch| simd::run(self.width, rows(batch)));
        }
        for vertex in here.partition.rounds[round][piece].vertices.iter().cloned().flatten() {
            change.set(vertex as usize, u.get(vertex as usize) - change.get(vertex as usize));
        }
    }

    /// Prolongates the correction of the finest level to a tile's vertices.
    pub(crate) fn correct(&self, task: &Task, tile: Range<u32>) {
        self.prolongate(task, 0, self.fine.1.within(task), tile);
    }

    fn prolongate(&self, task: &Task, level: usize, u: View<'_>, items: Range<u32>) {
        let (Aggregates { label, common, .. }, items) = (&self.levels[level], items.start as usize..items.end as usize);
        simd::run(self.width, Prolongate { label, common, change: self.state(level).change.within(task), u, items });
    }
}

/// Mass-weighted averages of the members. Positions are averaged relative to the first member, so that the rounding
/// error is in proportion to the aggregate's size, not to its distance from the origin.
struct Restrict<'t> {
    members: &'t Members,
    inverse_mass: &'t [f32],
    /// Positions of the members.
    x: View<'t>,
    /// Displacements of the members.
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
struct Prolongate<'t> {
    label: &'t Indices,
    common: &'t [u32],
    change: View<'t>,
    u: View<'t>,
    items: Range<usize>,
}

impl Loop for Prolongate<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Prolongate { label, common, change, u, items } = self;
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
