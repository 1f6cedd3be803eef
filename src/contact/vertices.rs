//! The loop that moves vertices out of the colliders.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec4;

use super::lanes::loaded;
use crate::kernels::contact::{Clear, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::params::Substep;
use crate::simd::{Loop, Registers};
use crate::step::plan::Plan;

/// Moves vertices out of the colliders.
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
