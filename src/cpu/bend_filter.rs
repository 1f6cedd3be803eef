//! Bending in several passes: vertices give way to the moments so far, and the rows take the moments of what is left
//! ([`step::bending`](crate::step::bending)).

use std::ops::Range;

use crate::cpu::force_batches::{RingBatches, Rings};
use crate::cpu::tasks::shared::{SharedArray, Task, View};
use crate::kernels::bending::{BendPass, next_moment};
use crate::simd::aligned::AlignedVec;
use crate::simd::{Loop, Registers, Vector};

/// What the passes keep of each vertex; empty if there is but one.
#[derive(Debug, Default)]
pub(crate) struct FilterArrays {
    /// Mean curvature normals of the rows.
    curvatures: AlignedVec,
    /// What the last pass changed the moments by; the moments are the forces' pulls.
    changes: AlignedVec,
    /// What each vertex gives way by (m).
    ways: AlignedVec,
    /// What damping adds to the pulls, if there is any.
    resisted: AlignedVec,
}

/// The same within a step.
#[derive(Debug)]
pub(crate) struct Filter<'a> {
    curvatures: SharedArray<'a>,
    changes: SharedArray<'a>,
    ways: SharedArray<'a>,
    resisted: SharedArray<'a>,
    passes: &'a [BendPass],
}

impl FilterArrays {
    /// Makes room for so many vertices, of which so many are damped.
    pub(crate) fn fit(&mut self, vertices: usize, damped: usize) {
        if [self.ways.len(), self.resisted.len()] != [vertices, damped] {
            // The old ones first, or memory would hold both.
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
    /// Pass number `pass` over the moments `pulls`, as a task sees it, if the scene has it.
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

/// A pass as a task sees it.
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
    /// The first pass over a group of rows, of curvature `y`; `resisted` is what damping is to add.
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

/// Vertices give way to the moments, before a pass.
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

/// A pass over rows whose vertices gave way.
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
