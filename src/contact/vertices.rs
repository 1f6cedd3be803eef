//! Loops over all vertices: out of the colliders, and near the paths that detection looked along.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec4;

use super::lanes::loaded;
use crate::kernels::contact::{Clear, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::params::Substep;
use crate::simd::{Loop, Registers};
use crate::step::plan::Plan;

/// Takes vertices out of the colliders.
pub(super) struct Meet<'a> {
    pub plan: &'a Plan<'a>,
    pub substep: &'a Substep,
    pub x: &'a [Vec4],
    pub u: &'a mut [Vec4],
    pub push: &'a mut [Vec4],
    pub is_pushed: &'a AtomicBool,
}

impl Loop for Meet<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Meet { plan, substep, x, u, push, is_pushed } = self;
        for first in (0..x.len()).step_by(L::LANES) {
            let end = x.len().min(first + L::LANES);
            let mut is_clear = end - first == L::LANES;
            if is_clear {
                let (x, u) = (loaded::<L>(&x[first..end]), loaded::<L>(&u[first..end]));
                for body in plan.bodies {
                    is_clear &= L::all(Clear::of(body, substep, plan.params.fraction).of_vertices(x, u));
                }
            }
            if is_clear {
                continue;
            }
            for i in (first..end).filter(|&i| x[i].w > 0.0) {
                let from = xyz(x[i]);
                let (mut at, mut by) = (from, xyz(u[i]));
                for body in plan.bodies {
                    (at, by) = contact_body(at, by, body, substep, &plan.params);
                }
                u[i] = by.extend(0.0);
                if at != from {
                    push[i] = (at - from).extend(0.0);
                    is_pushed.store(true, Ordering::Relaxed);
                }
            }
        }
    }
}

/// Looks whether vertices are within a limit of their paths.
pub(super) struct OnPath<'a> {
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    pub from: &'a [Vec4],
    pub by: &'a [Vec4],
    pub substeps: f32,
    pub limit: f32,
    pub all: &'a AtomicBool,
}

impl Loop for OnPath<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let OnPath { x, u, from, by, substeps, limit, all } = self;
        let steps = L::splat(substeps);
        let (mut farthest, whole) = (L::splat(0.0), x.len() / L::LANES * L::LANES);
        for first in (0..whole).step_by(L::LANES) {
            let lanes = first..first + L::LANES;
            let (x, u) = (loaded::<L>(&x[lanes.clone()]), loaded::<L>(&u[lanes.clone()]));
            let (from, by) = (loaded::<L>(&from[lanes.clone()]), loaded::<L>(&by[lanes]));
            let stray = (x - from) + (u - by * steps);
            // What is not a number is not below the limit.
            let square = stray.dot(stray);
            farthest = L::select(square.lt(L::splat(limit * limit)), farthest, L::splat(f32::INFINITY));
        }
        let stray = |i: usize| xyz(x[i]) - xyz(from[i]) + (xyz(u[i]) - xyz(by[i]) * substeps);
        let is_near = (whole..x.len()).all(|i| stray(i).length_squared() < limit * limit);
        if !(is_near && L::all(farthest.lt(L::splat(1.0)))) {
            all.store(false, Ordering::Relaxed);
        }
    }
}
