//! The coarse correction on the CPU: restrict, sweep each level, hand down. See `levels.rs`.

use std::ops::Range;

use glam::Vec4;

use crate::cloth::Cloth;
use crate::crew::Shared;
use crate::kernels::Edge;
use crate::lanes::Rule;
use crate::levels::Level;
use crate::lines::Lines;
use crate::packed::Packed;
use crate::plan::Plan;
use crate::stripes::{Stripes, Task};
use crate::wide::Breadth;

/// Aggregates that a task restricts.
const GRAIN: usize = 64;
/// Fewer aggregates than this are no work to share: the barriers would cost more.
const WORTHWHILE: usize = 2048;

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
    /// Their displacement (m): as predicted, and as corrected. Its w means nothing.
    predicted: Lines,
    u: Lines,
    stripes: Stripes,
    /// The edges of each round.
    edges: Vec<Packed>,
    /// The values above as the tasks of a step share them; made anew for each.
    at: Values,
}

#[derive(Debug, Clone, Copy)]
struct Values {
    x: Shared<Vec4>,
    predicted: Shared<Vec4>,
    u: Shared<Vec4>,
}

impl Aggregates {
    fn new(level: &Level) -> Aggregates {
        let mut zero = Lines::new(level.inverse_mass.len());
        let nowhere = Shared::new(&mut zero[..0]);
        Aggregates {
            x: zero.clone(),
            predicted: zero.clone(),
            stripes: Stripes::coarse(&level.links, zero.len()),
            u: zero,
            edges: Vec::new(),
            at: Values { x: nowhere, predicted: nowhere, u: nowhere },
        }
    }

    fn pack(&mut self, level: &Level, edges: &[Edge], breadth: Breadth) {
        let pack = |tasks: &Vec<Task>| Packed::new(tasks, edges, &level.colors, &level.inverse_mass, breadth);
        self.edges = self.stripes.rounds.iter().map(pack).collect();
    }

    fn share(&mut self) {
        let [x, predicted, u] = [&mut self.x, &mut self.predicted, &mut self.u].map(|values| Shared::new(values));
        self.at = Values { x, predicted, u };
    }
}

impl Coarse {
    /// Makes ready for substeps of another length: `edges` of each level in use.
    pub(crate) fn pack(&mut self, cloth: &Cloth, edges: &[Vec<Edge>], breadth: Breadth) {
        self.levels.truncate(edges.len());
        for (index, edges) in edges.iter().enumerate() {
            let level = &cloth.hierarchy().levels[index];
            if index == self.levels.len() {
                self.levels.push(Aggregates::new(level));
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
    ) -> Option<Correction<'a>> {
        self.levels.iter_mut().for_each(Aggregates::share);
        let apart = self.levels.iter().position(|level| level.x.len() < WORTHWHILE).unwrap_or(self.levels.len());
        (!self.levels.is_empty()).then(|| Correction {
            shapes: &plan.cloth.hierarchy().levels,
            fine: (x, u),
            levels: &self.levels,
            apart,
        })
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

    /// Mass-weighted averages of the items below. Positions are taken relative to the first, which keeps what single
    /// precision loses in proportion to the aggregate's size.
    fn restrict(&self, level: usize, aggregates: Range<usize>) {
        let (shape, to) = (&self.shapes[level], &self.levels[level]);
        let (x, u) = if level == 0 { self.fine } else { (self.levels[level - 1].at.x, self.levels[level - 1].at.u) };
        for aggregate in aggregates {
            let span = shape.members.spans[aggregate];
            let range = span.start as usize..span.end as usize;
            let members = &shape.members.items[range.clone()];
            let (mut dx, mut by) = (Vec4::ZERO, Vec4::ZERO);
            // SAFETY: see Correction.
            unsafe {
                let first = x.get(members[0] as usize);
                for (&item, &share) in members.iter().zip(&shape.share[range]) {
                    dx += (x.get(item as usize) - first) * share;
                    by += u.get(item as usize) * share;
                }
                to.at.x.set(aggregate, (first + dx).truncate().extend(shape.inverse_mass[aggregate]));
                to.at.predicted.set(aggregate, by);
                to.at.u.set(aggregate, by);
            }
        }
    }

    fn sweep(&self, level: usize, round: usize, task: usize) {
        let here = &self.levels[level];
        if round == 0 && level + 1 < self.levels.len() {
            self.hand_down_to(level, here.stripes.ranges[task].clone());
        }
        // SAFETY: see Correction.
        unsafe { here.edges[round].sweep(task, here.at.x, here.at.u, Rule::Pull) };
    }

    /// Adds to some aggregates of a level what their aggregates were corrected by.
    fn hand_down_to(&self, level: usize, items: Range<u32>) {
        let (label, from) = (&self.shapes[level + 1].label, self.levels[level + 1].at);
        hand_down(label, from, self.levels[level].at.u, items);
    }

    /// Adds to some vertices what their aggregates were corrected by.
    pub(crate) fn hand_down(&self, vertices: Range<u32>) {
        hand_down(&self.shapes[0].label, self.levels[0].at, self.fine.1, vertices);
    }
}

/// Adds to each item below what its aggregate was corrected by.
#[expect(unsafe_code, reason = "see Correction")]
fn hand_down(label: &[u32], from: Values, u: Shared<Vec4>, items: Range<u32>) {
    for item in items {
        let aggregate = label[item as usize] as usize;
        // SAFETY: see Correction.
        unsafe { u.set(item as usize, u.get(item as usize) + (from.u.get(aggregate) - from.predicted.get(aggregate))) };
    }
}
