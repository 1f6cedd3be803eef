//! The coarse correction on the CPU: restrict, sweep each level, hand down. See `levels.rs`.

use std::ops::Range;

use glam::Vec4;

use crate::cloth::Cloth;
use crate::crew::Shared;
use crate::kernels::Edge;
use crate::lanes::{Breadth, Packed, Rule};
use crate::levels::Level;
use crate::plan::Plan;
use crate::stripes::Stripes;

/// Aggregates that a task restricts.
const GRAIN: usize = 128;

/// What each level's aggregates do in a substep, the finest first; nothing without levels.
#[derive(Debug, Default)]
pub(crate) struct Coarse {
    levels: Vec<Aggregates>,
}

/// The aggregates of a level.
#[derive(Debug)]
struct Aggregates {
    /// Centres (m), w the inverse mass (1/kg).
    x: Vec<Vec4>,
    /// Their displacement (m): as predicted, and as corrected. Its w means nothing.
    predicted: Vec<Vec4>,
    u: Vec<Vec4>,
    stripes: Stripes,
    first: Packed,
    second: Packed,
}

impl Aggregates {
    fn new(level: &Level) -> Aggregates {
        let zero = vec![Vec4::ZERO; level.inverse_mass.len()];
        let stripes = Stripes::new(&level.links, level.links.len(), zero.len());
        let (first, second) = (Packed::default(), Packed::default());
        Aggregates { x: zero.clone(), predicted: zero.clone(), u: zero, stripes, first, second }
    }

    fn pack(&mut self, level: &Level, edges: &[Edge]) {
        for (packed, tasks) in [(&mut self.first, &self.stripes.first), (&mut self.second, &self.stripes.second)] {
            packed.pack(tasks, edges, &level.colors, &level.inverse_mass);
        }
    }

    fn share(&mut self) -> Part<'_> {
        let [x, predicted, u] = [&mut self.x, &mut self.predicted, &mut self.u].map(|values| Shared::new(values));
        Part { x, predicted, u, first: &self.first, second: &self.second }
    }
}

impl Coarse {
    /// Makes ready for substeps of another length: `edges` of each level in use.
    pub(crate) fn pack(&mut self, cloth: &Cloth, edges: &[Vec<Edge>]) {
        self.levels.truncate(edges.len());
        for (index, edges) in edges.iter().enumerate() {
            let level = &cloth.hierarchy().levels[index];
            if index == self.levels.len() {
                self.levels.push(Aggregates::new(level));
            }
            self.levels[index].pack(level, edges);
        }
    }

    /// Tasks of the rounds of a correction: restriction, coarser levels, and the finest level's stripes and borders.
    pub(crate) fn tasks(&self) -> Option<[usize; 4]> {
        let finest = self.levels.first()?;
        Some([finest.x.len().div_ceil(GRAIN), 1, finest.stripes.first.len(), finest.stripes.second.len()])
    }

    /// The correction of displacements `u` that were predicted from `x`; none without levels.
    pub(crate) fn share<'a>(
        &'a mut self,
        plan: &'a Plan<'_>,
        x: Shared<Vec4>,
        u: Shared<Vec4>,
        breadth: Breadth,
    ) -> Option<Correction<'a>> {
        let (finest, coarser) = self.levels.split_first_mut()?;
        Some(Correction {
            shapes: &plan.cloth.hierarchy().levels,
            x,
            u,
            finest: finest.share(),
            coarser: Shared::new(coarser),
            breadth,
        })
    }
}

/// A level as the tasks of a round share it.
#[derive(Debug, Clone, Copy)]
struct Part<'a> {
    x: Shared<Vec4>,
    predicted: Shared<Vec4>,
    u: Shared<Vec4>,
    first: &'a Packed,
    second: &'a Packed,
}

/// The rounds of a correction, over state that their tasks share.
///
/// Why no two tasks meet: tasks of a restriction write aggregates of their own, and read what no one writes in that round; the
/// coarser levels are one task; stripes and borders are kept apart by [`Stripes`]; and a vertex is handed its share by the
/// task that goes on with it.
#[derive(Debug)]
pub(crate) struct Correction<'a> {
    shapes: &'a [Level],
    x: Shared<Vec4>,
    u: Shared<Vec4>,
    finest: Part<'a>,
    coarser: Shared<Aggregates>,
    breadth: Breadth,
}

#[expect(unsafe_code, reason = "see Correction; labels and members are indices into the level below")]
impl Correction<'_> {
    /// Restricts from the vertices to some aggregates of the finest level.
    pub(crate) fn restrict(&self, task: usize) {
        let end = ((task + 1) * GRAIN).min(self.finest.x.len());
        // SAFETY: see Correction.
        unsafe { restrict(&self.shapes[0], self.x, self.u, self.finest, task * GRAIN..end) };
    }

    /// Restricts to the coarser levels, sweeps them, and hands down to the finest.
    pub(crate) fn coarser(&self) {
        // SAFETY: see Correction: this is the round's only task.
        let coarser = unsafe { std::slice::from_raw_parts_mut(self.coarser.pointer(), self.coarser.len()) };
        let (mut x, mut u) = (self.finest.x, self.finest.u);
        for (level, shape) in coarser.iter_mut().zip(&self.shapes[1..]) {
            let part = level.share();
            let all = 0..part.x.len();
            // SAFETY: nobody else is here.
            unsafe { restrict(shape, x, u, part, all) };
            (x, u) = (part.x, part.u);
        }
        for index in (0..coarser.len()).rev() {
            let (finer, here) = coarser.split_at_mut(index);
            let tasks = [here[0].stripes.first.len(), here[0].stripes.second.len()];
            let part = here[0].share();
            let below = finer.last_mut().map_or(self.finest, Aggregates::share);
            let all = 0..below.u.len();
            // SAFETY: nobody else is here.
            unsafe {
                (0..tasks[0]).for_each(|task| part.first.sweep(task, part.x, part.u, Rule::Pull, self.breadth));
                (0..tasks[1]).for_each(|task| part.second.sweep(task, part.x, part.u, Rule::Pull, self.breadth));
                hand_down(&self.shapes[index + 1].label, part, below.u, all);
            }
        }
    }

    /// Sweeps some of the finest level's edges, those of its stripes or between them.
    pub(crate) fn sweep(&self, task: usize, borders: bool) {
        let edges = if borders { self.finest.second } else { self.finest.first };
        // SAFETY: see Correction.
        unsafe { edges.sweep(task, self.finest.x, self.finest.u, Rule::Pull, self.breadth) };
    }

    /// Adds to some vertices what their aggregates were corrected by.
    pub(crate) fn hand_down(&self, vertices: Range<u32>) {
        // SAFETY: see Correction.
        unsafe { hand_down(&self.shapes[0].label, self.finest, self.u, vertices.start as usize..vertices.end as usize) };
    }
}

/// Mass-weighted averages of the items below. Positions are taken relative to the first, which keeps what single precision
/// loses in proportion to the aggregate's size.
#[expect(unsafe_code, reason = "see Correction")]
unsafe fn restrict(shape: &Level, x: Shared<Vec4>, u: Shared<Vec4>, part: Part<'_>, aggregates: Range<usize>) {
    for aggregate in aggregates {
        let span = shape.members.spans[aggregate];
        let range = span.start as usize..span.end as usize;
        let members = &shape.members.items[range.clone()];
        let (mut dx, mut by) = (Vec4::ZERO, Vec4::ZERO);
        // SAFETY: the caller's promise.
        unsafe {
            let first = x.get(members[0] as usize);
            for (&item, &share) in members.iter().zip(&shape.share[range]) {
                dx += (x.get(item as usize) - first) * share;
                by += u.get(item as usize) * share;
            }
            part.x.set(aggregate, (first + dx).truncate().extend(shape.inverse_mass[aggregate]));
            part.predicted.set(aggregate, by);
            part.u.set(aggregate, by);
        }
    }
}

/// Adds to each item below what its aggregate was corrected by.
#[expect(unsafe_code, reason = "see Correction")]
unsafe fn hand_down(label: &[u32], part: Part<'_>, u: Shared<Vec4>, items: Range<usize>) {
    for item in items {
        let aggregate = label[item] as usize;
        // SAFETY: the caller's promise.
        unsafe { u.set(item, u.get(item) + (part.u.get(aggregate) - part.predicted.get(aggregate))) };
    }
}
