//! The coarse correction on the CPU: restrict, sweep each level, hand down. See `levels.rs`.

use std::ops::Range;

use glam::Vec4;

use crate::cpu::edge_batches::Packed;
use crate::cpu::partition::{Stripes, Task};
use crate::cpu::shared::Shared;
use crate::cpu::sweep::Rule;
use crate::kernels::Edge;
use crate::multigrid::hierarchy::Level;
use crate::simd::aligned::Lines;
use crate::simd::{self, At, Breadth, Loop, Wide};
use crate::step::plan::Plan;

/// Aggregates that a task restricts.
const GRAIN: usize = 64;
/// Fewer aggregates than this are no work to share: to wait for one another would cost more.
const WORTHWHILE: usize = 2048;
/// No one aggregate.
const MIXED: u32 = u32::MAX;

/// What each level's aggregates do in a substep, the finest first; nothing without levels.
#[derive(Debug, Default)]
pub(crate) struct Coarse {
    levels: Vec<Aggregates>,
}

/// The aggregates of a level.
#[derive(Debug)]
struct Aggregates {
    /// Centres (m), w the inverse mass (1/kg).
    x: Lines,
    /// Their displacement (m): as predicted, and once it is done with, what it was corrected by. Its w means nothing.
    change: Lines,
    /// As corrected.
    u: Lines,
    members: Members,
    /// Which aggregate items below are of, as many together as a register holds; [`MIXED`] if of several.
    of: Vec<u32>,
    stripes: Stripes,
    /// The edges of each round.
    edges: Vec<Packed>,
    /// The values above as the tasks of a step share them; made anew for each.
    at: Values,
}

#[derive(Debug, Clone, Copy)]
struct Values {
    x: Shared<Vec4>,
    change: Shared<Vec4>,
    u: Shared<Vec4>,
}

/// The items of each aggregate in whole registers, ascending, and their shares of its mass; the first comes again at the end, with
/// none.
#[derive(Debug, Default)]
struct Members {
    items: Vec<u32>,
    shares: Vec<f32>,
    /// Where each aggregate's begin, and the last one's end.
    starts: Vec<usize>,
}

impl Members {
    fn new(level: &Level, breadth: Breadth) -> Members {
        let mut members = Members { starts: vec![0], ..Members::default() };
        for span in &level.members.spans {
            let range = span.start as usize..span.end as usize;
            let first = level.members.items[range.start];
            members.items.extend(&level.members.items[range.clone()]);
            members.shares.extend(&level.share[range]);
            let whole = members.items.len().next_multiple_of(breadth.lanes() / 4);
            members.items.resize(whole, first);
            members.shares.resize(whole, 0.0);
            members.starts.push(whole);
        }
        members
    }
}

/// The label that all of these are.
fn one(labels: &[u32]) -> u32 {
    if labels.iter().all(|&label| label == labels[0]) { labels[0] } else { MIXED }
}

impl Aggregates {
    fn new(level: &Level, breadth: Breadth) -> Aggregates {
        let mut zero = Lines::new(level.inverse_mass.len());
        let nowhere = Shared::new(&mut zero[..0]);
        Aggregates {
            x: zero.clone(),
            change: zero.clone(),
            members: Members::new(level, breadth),
            of: level.label.chunks(breadth.lanes() / 4).map(one).collect(),
            stripes: if zero.len() < WORTHWHILE {
                Stripes::one(&level.links, zero.len())
            } else {
                Stripes::coarse(&level.links, zero.len())
            },
            u: zero,
            edges: Vec::new(),
            at: Values { x: nowhere, change: nowhere, u: nowhere },
        }
    }

    fn pack(&mut self, level: &Level, edges: &[Edge], breadth: Breadth) {
        self.edges = Vec::new();
        let pack = |tasks: &Vec<Task>| Packed::new(tasks, edges, &level.colors, &level.inverse_mass, breadth);
        self.edges = self.stripes.rounds.iter().map(pack).collect();
    }

    fn share(&mut self) {
        let [x, change, u] = [&mut self.x, &mut self.change, &mut self.u].map(Lines::share);
        self.at = Values { x, change, u };
    }
}

impl Coarse {
    /// Makes ready for substeps of another length: `edges` of each level in use.
    pub(crate) fn pack(&mut self, levels: &[Level], edges: &[Vec<Edge>], breadth: Breadth) {
        self.levels.truncate(edges.len());
        for (index, edges) in edges.iter().enumerate() {
            let level = &levels[index];
            if index == self.levels.len() {
                self.levels.push(Aggregates::new(level, breadth));
            }
            self.levels[index].pack(level, edges, breadth);
        }
    }

    /// The correction of displacements `u` that were predicted from `x`; none without levels.
    pub(crate) fn share<'a>(
        &'a mut self,
        plan: &'a Plan<'_>,
        x: Shared<Vec4>,
        u: Shared<Vec4>,
        breadth: Breadth,
    ) -> Option<Correction<'a>> {
        self.levels.iter_mut().for_each(Aggregates::share);
        let apart = self.levels.iter().position(|level| level.x.len() < WORTHWHILE).unwrap_or(self.levels.len());
        (!self.levels.is_empty()).then(|| Correction { shapes: plan.levels, fine: (x, u), levels: &self.levels, breadth, apart })
    }
}

/// Tasks of a round, at the level named.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Tasks {
    /// Restrict to some of its aggregates.
    Restrict(usize),
    /// All that it and the coarser levels do.
    All(usize),
    /// Sweep some of its edges, in this round of [`Stripes`].
    Sweep(usize, usize),
}

/// The rounds of a correction, over state that their tasks share.
///
/// Why no two tasks meet: tasks of a restriction write aggregates of their own, and read what no one writes in that round; levels too
/// small to share are one task together; stripes and borders are kept apart by [`Stripes`]; and an item is handed its share by
/// the task that goes on with it.
#[derive(Debug)]
pub(crate) struct Correction<'a> {
    shapes: &'a [Level],
    fine: (Shared<Vec4>, Shared<Vec4>),
    levels: &'a [Aggregates],
    breadth: Breadth,
    /// Levels with rounds of their own, the finest ones.
    apart: usize,
}

#[expect(unsafe_code, reason = "see Correction; labels and members are indices into the level below")]
impl Correction<'_> {
    /// Names the rounds in order, and how many tasks each has.
    pub(crate) fn rounds(&self, mut add: impl FnMut(Tasks, usize)) {
        // Restriction from the vertices is work enough.
        (0..self.apart.max(1)).for_each(|level| add(Tasks::Restrict(level), self.levels[level].x.len().div_ceil(GRAIN)));
        add(Tasks::All(self.apart), usize::from(self.apart < self.levels.len()));
        for level in (0..self.apart).rev() {
            let rounds = self.levels[level].stripes.rounds.iter().enumerate();
            rounds.for_each(|(round, tasks)| add(Tasks::Sweep(level, round), tasks.len()));
        }
    }

    /// One task.
    pub(crate) fn work(&self, tasks: Tasks, task: usize) {
        match tasks {
            Tasks::Restrict(level) => {
                let count = self.levels[level].x.len();
                self.restrict(level, task * GRAIN..((task + 1) * GRAIN).min(count));
            }
            Tasks::All(first) => {
                for level in first.max(1)..self.levels.len() {
                    self.restrict(level, 0..self.levels[level].x.len());
                }
                for level in (first..self.levels.len()).rev() {
                    for (round, tasks) in self.levels[level].stripes.rounds.iter().enumerate() {
                        (0..tasks.len()).for_each(|task| self.sweep(level, round, task));
                    }
                }
            }
            Tasks::Sweep(level, round) => self.sweep(level, round, task),
        }
    }

    fn restrict(&self, level: usize, aggregates: Range<usize>) {
        let to = &self.levels[level];
        let (x, u) = if level == 0 { self.fine } else { (self.levels[level - 1].at.x, self.levels[level - 1].at.u) };
        let (members, inverse_mass) = (&to.members, &self.shapes[level].inverse_mass);
        let restrict = Restrict { members, inverse_mass, x, u, to: to.at, aggregates };
        // SAFETY: see Correction.
        unsafe { simd::run(self.breadth, restrict) };
    }

    fn sweep(&self, level: usize, round: usize, task: usize) {
        let here = &self.levels[level];
        if round == 0 && level + 1 < self.levels.len() {
            self.hand_down_to(level, here.stripes.ranges[task].clone());
        }
        let Values { x, change, u } = here.at;
        // SAFETY: see Correction.
        unsafe {
            here.edges[round].sweep(task, x, u, Rule::Pull);
            for vertex in here.stripes.rounds[round][task].vertices.iter().cloned().flatten() {
                change.set(vertex as usize, u.get(vertex as usize) - change.get(vertex as usize));
            }
        }
    }

    /// Adds to some aggregates of a level what their aggregates were corrected by.
    fn hand_down_to(&self, level: usize, items: Range<u32>) {
        self.hand(level + 1, self.levels[level].at.u, items);
    }

    /// Adds to some vertices what their aggregates were corrected by.
    pub(crate) fn hand_down(&self, vertices: Range<u32>) {
        self.hand(0, self.fine.1, vertices);
    }

    fn hand(&self, from: usize, u: Shared<Vec4>, items: Range<u32>) {
        let Aggregates { at: Values { change, .. }, of, .. } = &self.levels[from];
        let items = items.start as usize..items.end as usize;
        // SAFETY: see Correction.
        unsafe { simd::run(self.breadth, HandDown { label: &self.shapes[from].label, of, change: *change, u, items }) };
    }
}

/// Mass-weighted averages of the items below. Positions are taken relative to the first, which keeps what single
/// precision loses in proportion to the aggregate's size.
struct Restrict<'a> {
    members: &'a Members,
    inverse_mass: &'a [f32],
    /// Of the items.
    x: Shared<Vec4>,
    u: Shared<Vec4>,
    to: Values,
    aggregates: Range<usize>,
}

#[expect(unsafe_code, reason = "see Correction; labels and members are indices into the level below")]
impl Loop for Restrict<'_> {
    #[inline(always)]
    unsafe fn run<W: Wide>(self) {
        let Restrict { members, inverse_mass, x, u, to, aggregates } = self;
        for aggregate in aggregates {
            let range = members.starts[aggregate]..members.starts[aggregate + 1];
            let items = members.items[range.clone()].chunks_exact(W::LANES / 4);
            let shares = members.shares[range.clone()].chunks_exact(W::LANES / 4);
            // SAFETY: the caller's promise.
            unsafe {
                let first = x.get(members.items[range.start] as usize);
                let (origin, mut dx, mut by) = (W::repeat(first), W::splat(0.0), W::splat(0.0));
                for (items, shares) in items.zip(shares) {
                    let (at, share) = (simd::ascending::<W>(items), W::each(shares));
                    dx = (W::load(x, at) - origin).times_plus(share, dx);
                    by = W::load(u, at).times_plus(share, by);
                }
                let by = by.sum();
                to.x.set(aggregate, (first + dx.sum()).truncate().extend(inverse_mass[aggregate]));
                to.change.set(aggregate, by);
                to.u.set(aggregate, by);
            }
        }
    }
}

/// Adds to each item what its aggregate was corrected by.
struct HandDown<'a> {
    label: &'a [u32],
    /// The same, as in [`Aggregates`].
    of: &'a [u32],
    change: Shared<Vec4>,
    u: Shared<Vec4>,
    items: Range<usize>,
}

#[expect(unsafe_code, reason = "see Correction")]
impl Loop for HandDown<'_> {
    #[inline(always)]
    unsafe fn run<W: Wide>(self) {
        let HandDown { label, of, change, u, items } = self;
        let group = W::LANES / 4;
        let rest = items.end - items.len() % group;
        for (&of, first) in of[items.start / group..rest / group].iter().zip((items.start..rest).step_by(group)) {
            // SAFETY: the caller's promise; ranges of items begin with whole registers.
            unsafe {
                // Neighbours are mostly of one aggregate.
                let by = match of {
                    MIXED => W::load(change, simd::listed::<W>(&label[first..first + group])),
                    one => W::repeat(change.get(one as usize)),
                };
                (W::load(u, At::Beside(first)) + by).store(u, At::Beside(first));
            }
        }
        for (item, &label) in (rest..items.end).zip(&label[rest..items.end]) {
            // SAFETY: the caller's promise.
            unsafe { u.set(item, u.get(item) + change.get(label as usize)) };
        }
    }
}
