//! The coarse correction on the CPU: restrict, sweep each level, hand down. See `levels.rs`.

use glam::Vec4;
use rayon::prelude::*;

use crate::kernels::{self, xyz};
use crate::levels::Level;
use crate::plan::Plan;

/// Items a rayon task takes at a time, and from how many on loops are parallel.
const GRAIN: usize = 256;
const PARALLEL: usize = 8 * GRAIN;

/// What each level's aggregates do in a substep; nothing without levels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Coarse {
    levels: Vec<Aggregates>,
}

#[derive(Debug, Clone, Default)]
struct Aggregates {
    /// Centres (m), w the inverse mass (1/kg).
    x: Vec<Vec4>,
    /// Their displacement (m): as predicted, and as corrected.
    predicted: Vec<Vec4>,
    u: Vec<Vec4>,
}

impl Coarse {
    /// Corrects the displacements `u` that were predicted from `x`.
    pub(crate) fn correct(&mut self, plan: &Plan<'_>, x: &[Vec4], u: &mut [Vec4]) {
        let edges = &plan.coefficients.levels;
        if edges.is_empty() {
            return;
        }
        let shapes = &plan.cloth.hierarchy().levels[..edges.len()];
        self.levels.resize_with(edges.len(), Aggregates::default);
        self.levels[0].restrict(&shapes[0], x, u);
        for index in 1..shapes.len() {
            let (finer, coarser) = self.levels.split_at_mut(index);
            coarser[0].restrict(&shapes[index], &finer[index - 1].x, &finer[index - 1].u);
        }
        for index in (0..shapes.len()).rev() {
            let (here, coarser) = self.levels.split_at_mut(index + 1);
            let here = &mut here[index];
            if let Some(coarser) = coarser.first() {
                coarser.hand_down(&shapes[index + 1].label, &mut here.u);
            }
            let x = &here.x;
            edges[index].for_each(&mut here.u, |edge, u_a, u_b| {
                let (x_a, x_b) = (x[edge.a as usize], x[edge.b as usize]);
                let impulse = kernels::project_coarse(xyz(x_a - x_b), xyz(*u_a - *u_b), edge).extend(0.0);
                *u_a += impulse * x_a.w;
                *u_b -= impulse * x_b.w;
            });
        }
        self.levels[0].hand_down(&shapes[0].label, u);
    }
}

impl Aggregates {
    /// Mass-weighted averages of the items below. Positions are taken relative to the first, which keeps what single precision
    /// loses in proportion to the aggregate's size.
    fn restrict(&mut self, shape: &Level, x: &[Vec4], u: &[Vec4]) {
        let count = shape.inverse_mass.len();
        self.x.resize(count, Vec4::ZERO);
        self.predicted.resize(count, Vec4::ZERO);
        let average = |aggregate: usize| {
            let span = shape.members.spans[aggregate];
            let range = span.start as usize..span.end as usize;
            let members = &shape.members.items[range.clone()];
            let first = x[members[0] as usize];
            let (mut dx, mut by) = (Vec4::ZERO, Vec4::ZERO);
            for (&item, &share) in members.iter().zip(&shape.share[range]) {
                dx += (x[item as usize] - first) * share;
                by += u[item as usize] * share;
            }
            ((first + dx).truncate().extend(shape.inverse_mass[aggregate]), by)
        };
        let store = |(aggregate, (x, u)): (usize, (&mut Vec4, &mut Vec4))| (*x, *u) = average(aggregate);
        if count < PARALLEL {
            self.x.iter_mut().zip(&mut self.predicted).enumerate().for_each(store);
        } else {
            self.x.par_iter_mut().zip(&mut self.predicted).with_min_len(GRAIN).enumerate().for_each(store);
        }
        self.u.clone_from(&self.predicted);
    }

    /// Adds to each item below what its aggregate was corrected by.
    fn hand_down(&self, label: &[u32], below: &mut [Vec4]) {
        let add = |(u, &aggregate): (&mut Vec4, &u32)| *u += self.u[aggregate as usize] - self.predicted[aggregate as usize];
        if below.len() < PARALLEL {
            below.iter_mut().zip(label).for_each(add);
        } else {
            below.par_iter_mut().zip(label).with_min_len(GRAIN).for_each(add);
        }
    }
}
