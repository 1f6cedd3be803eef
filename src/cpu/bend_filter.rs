//! Bending in several passes (the Chebyshev filter of [`step::bending`](crate::step::bending)): before each pass the
//! vertices are displaced tentatively under the moments so far, and the rows recompute their moments from the displaced
//! rings.

use std::ops::Range;

use crate::cpu::force_batches::{RingBatches, Rings};
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::kernels::bending::{BendPass, next_moment};
use crate::simd::aligned::AlignedVec;
use crate::simd::{Loop, Registers, Vector};

/// What the passes keep for each vertex. The lists are empty if there is only one pass.
#[derive(Debug, Default)]
pub(crate) struct FilterArrays {
    /// Mean curvature normals of the rows before any tentative displacement.
    curvatures: AlignedVec,
    /// How much the last pass changed the moments; the moments themselves are `pulls` of the forces.
    changes: AlignedVec,
    /// Tentative displacement of each vertex (m).
    ways: AlignedVec,
    /// The damping part of each moment, added after the last pass; empty without damping.
    resisted: AlignedVec,
}

/// The same arrays, shared by the tasks of a step.
#[derive(Debug)]
pub(crate) struct Filter<'a> {
    curvatures: SharedArray<'a>,
    changes: SharedArray<'a>,
    ways: SharedArray<'a>,
    resisted: SharedArray<'a>,
    passes: &'a [BendPass],
}

impl FilterArrays {
    /// Resizes the lists for `vertices` vertices, and the damping list for `damped` of them.
    pub(crate) fn fit(&mut self, vertices: usize, damped: usize) {
        if [self.ways.len(), self.resisted.len()] != [vertices, damped] {
            // The old lists are dropped before new ones are made, so that memory never holds both.
            *self = FilterArrays::default();
            let list = || AlignedVec::new(vertices);
            *self = FilterArrays { curvatures: list(), changes: list(), ways: list(), resisted: AlignedVec::new(damped) };
        }
    }

    pub(crate) fn share<'a>(&'a mut self, passes: &'a [BendPass]) -> Filter<'a> {
        let FilterArrays { curvatures, changes, ways, resisted } = self;
        let [curvatures, changes, ways, resisted] =
            [curvatures, changes, ways, resisted].map(|list| SharedArray::new(list.room()));
        Filter { curvatures, changes, ways, resisted, passes }
    }
}

impl Filter<'_> {
    /// Pass number `pass` over the moments `pulls` as one task sees it; none if the scene has fewer passes.
    pub(crate) fn pass<'t>(&'t self, task: &'t Task, pulls: View<'t>, pass: usize) -> Option<Pass<'t>> {
        Some(Pass {
            pulls,
            curvatures: self.curvatures.within(task),
            changes: self.changes.within(task),
            ways: self.ways.within(task),
            resisted: (!self.resisted.is_empty()).then(|| self.resisted.within(task)),
            numbers: self.passes.get(pass)?,
        })
    }
}

/// One pass of the filter, as a task sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pass<'t> {
    pulls: View<'t>,
    curvatures: View<'t>,
    changes: View<'t>,
    ways: View<'t>,
    resisted: Option<View<'t>>,
    numbers: &'t BendPass,
}

impl Pass<'_> {
    /// Runs the first pass over a group of rows with curvature normal `y`. `resisted` is the damping part of the
    /// moments.
    #[inline(always)]
    pub(crate) fn begin<L: Registers>(&self, first: usize, y: Vector<L>, stiffness: L, resisted: Option<Vector<L>>) {
        let [moment, change] = next_moment(Vector::zero(), Vector::zero(), y, stiffness, self.numbers);
        self.curvatures.set_vectors(first, y);
        self.pulls.set_vectors(first, moment);
        self.changes.set_vectors(first, change);
        if let (Some(list), Some(resisted)) = (self.resisted, resisted) {
            list.set_vectors(first, resisted);
        }
    }
}

/// Computes the tentative displacements of groups of vertices under the moments, before a pass.
pub(crate) struct GiveWay<'t> {
    pub rings: &'t RingBatches,
    pub groups: Range<usize>,
    pub pass: Pass<'t>,
}

impl Loop for GiveWay<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let GiveWay { rings, pass: Pass { pulls, ways, numbers, .. }, .. } = self;
        for group in self.groups {
            let first = group * L::LANES;
            let Rings { diagonal, inverse_mass, .. } = rings.group::<L>(group);
            let mut force = pulls.vectors(first) * diagonal;
            for near in rings.neighbors(group) {
                force = rings.gather(pulls, near).mul_add(rings.backward(near), force);
            }
            ways.set_vectors(first, force * (inverse_mass * L::splat(numbers.way)));
        }
    }
}

/// Runs a pass over groups of rows after the tentative displacement of their rings.
pub(crate) struct BendAgain<'t> {
    pub rings: &'t RingBatches,
    pub groups: Range<usize>,
    pub pass: Pass<'t>,
}

impl Loop for BendAgain<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let BendAgain { rings, pass: Pass { pulls, curvatures, changes, ways, resisted, numbers }, .. } = self;
        for group in self.groups {
            let first = group * L::LANES;
            let own = ways.vectors::<L>(first);
            let mut y = curvatures.vectors(first);
            for near in rings.neighbors(group) {
                y = (rings.gather(ways, near) - own).mul_add(rings.forward(near), y);
            }
            let (moment, change) = (pulls.vectors(first), changes.vectors(first));
            let [moment, change] = next_moment(moment, change, y, rings.group(group).stiffness, numbers);
            let is_last = numbers.last != 0;
            match resisted.filter(|_| is_last) {
                Some(resisted) => pulls.set_vectors(first, moment + resisted.vectors(first)),
                None => pulls.set_vectors(first, moment),
            }
            if !is_last {
                changes.set_vectors(first, change);
            }
        }
    }
}
