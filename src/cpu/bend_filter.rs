//! Bending in several passes (the Chebyshev filter of [`step::bending`](crate::step::bending)): before each pass the
//! vertices are displaced tentatively under the moments so far, and the rows recompute their moments from the displaced
//! rings.

use std::ops::Range;

use crate::cpu::force_batches::{RingBatches, RingLanes};
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::kernels::bending::{BendPass, next_moment};
use crate::simd::aligned::AlignedVec;
use crate::simd::{Loop, Registers, Vector};

/// What the passes keep for each vertex. The lists are empty if there is only one pass.
#[derive(Debug, Default)]
pub(crate) struct FilterArrays {
    /// Mean curvature normals of the rows before any tentative displacement.
    curvatures: AlignedVec,
    /// How much the last pass changed the moments, which are those of [`ForceArrays`](crate::cpu::forces::ForceArrays).
    changes: AlignedVec,
    /// Tentative displacement of each vertex (m).
    trials: AlignedVec,
    /// The damping part of each moment, added after the last pass; empty without damping.
    resisted: AlignedVec,
}

/// The same arrays, shared by the tasks of a step.
pub(crate) struct Filter<'a> {
    curvatures: SharedArray<'a>,
    changes: SharedArray<'a>,
    trials: SharedArray<'a>,
    resisted: SharedArray<'a>,
    passes: &'a [BendPass],
}

impl FilterArrays {
    /// Resizes the lists for `vertices` vertices, and the damping list for `damped` of them.
    pub(crate) fn fit(&mut self, vertices: usize, damped: usize) {
        if [self.trials.len(), self.resisted.len()] != [vertices, damped] {
            // The old lists are dropped before new ones are made, so that memory never holds both.
            *self = FilterArrays::default();
            let list = || AlignedVec::new(vertices);
            *self = FilterArrays { curvatures: list(), changes: list(), trials: list(), resisted: AlignedVec::new(damped) };
        }
    }

    pub(crate) fn share<'a>(&'a mut self, passes: &'a [BendPass]) -> Filter<'a> {
        let FilterArrays { curvatures, changes, trials, resisted } = self;
        let [curvatures, changes, trials, resisted] =
            [curvatures, changes, trials, resisted].map(|list| SharedArray::new(list.room()));
        Filter { curvatures, changes, trials, resisted, passes }
    }
}

impl Filter<'_> {
    /// Pass number `pass` over the moments `moments` as one task sees it; none if the scene has fewer passes.
    pub(crate) fn pass<'t>(&'t self, task: &'t Task, moments: View<'t>, pass: usize) -> Option<FilterPass<'t>> {
        Some(FilterPass {
            moments,
            curvatures: self.curvatures.within(task),
            changes: self.changes.within(task),
            trials: self.trials.within(task),
            resisted: (!self.resisted.is_empty()).then(|| self.resisted.within(task)),
            numbers: self.passes.get(pass)?,
        })
    }
}

/// One pass of the filter, as a task sees it.
#[derive(Clone, Copy)]
pub(crate) struct FilterPass<'t> {
    moments: View<'t>,
    curvatures: View<'t>,
    changes: View<'t>,
    trials: View<'t>,
    resisted: Option<View<'t>>,
    numbers: &'t BendPass,
}

impl FilterPass<'_> {
    /// Runs the first pass over a group of rows with curvature normal `y`. `resisted` is the damping part of the
    /// moments.
    #[inline(always)]
    pub(crate) fn begin<L: Registers>(&self, first: usize, y: Vector<L>, stiffness: L, resisted: Option<Vector<L>>) {
        let [moment, change] = next_moment(Vector::zero(), Vector::zero(), y, stiffness, self.numbers);
        self.curvatures.set_vectors(first, y);
        self.moments.set_vectors(first, moment);
        self.changes.set_vectors(first, change);
        if let (Some(list), Some(resisted)) = (self.resisted, resisted) {
            list.set_vectors(first, resisted);
        }
    }
}

/// Computes the tentative displacements of groups of vertices under the moments, before a pass.
pub(crate) struct TrialDisplacements<'t> {
    pub rings: &'t RingBatches,
    pub groups: Range<usize>,
    pub pass: FilterPass<'t>,
}

impl Loop for TrialDisplacements<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let TrialDisplacements { rings, pass: FilterPass { moments, trials, numbers, .. }, .. } = self;
        for group in self.groups {
            let first = group * L::LANES;
            let RingLanes { diagonal, inverse_mass, .. } = rings.group::<L>(group);
            let mut force = moments.vectors(first) * diagonal;
            for near in rings.neighbors(group) {
                force = rings.gather(moments, near).mul_add(rings.backward(near), force);
            }
            trials.set_vectors(first, force * (inverse_mass * L::splat(numbers.trial)));
        }
    }
}

/// Runs a pass over groups of rows after the tentative displacement of their rings.
pub(crate) struct FilterMoments<'t> {
    pub rings: &'t RingBatches,
    pub groups: Range<usize>,
    pub pass: FilterPass<'t>,
}

impl Loop for FilterMoments<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let FilterMoments { rings, pass: FilterPass { moments, curvatures, changes, trials, resisted, numbers }, .. } = self;
        for group in self.groups {
            let first = group * L::LANES;
            let own = trials.vectors::<L>(first);
            let mut y = curvatures.vectors(first);
            for near in rings.neighbors(group) {
                y = (rings.gather(trials, near) - own).mul_add(rings.forward(near), y);
            }
            let (moment, change) = (moments.vectors(first), changes.vectors(first));
            let [moment, change] = next_moment(moment, change, y, rings.group(group).stiffness, numbers);
            let is_last = numbers.last != 0;
            match resisted.filter(|_| is_last) {
                Some(resisted) => moments.set_vectors(first, moment + resisted.vectors(first)),
                None => moments.set_vectors(first, moment),
            }
            if !is_last {
                changes.set_vectors(first, change);
            }
        }
    }
}
