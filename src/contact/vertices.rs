//! The loops that move vertices out of the colliders.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::Vec4;

use super::input::Vertex;
use super::lanes::loaded;
use crate::kernels::contact::{Clear, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::params::Substep;
use crate::simd::{Loop, Registers};
use crate::step::plan::Plan;

/// Moves vertices out of the colliders.
pub(super) struct PushOut<'a> {
    pub plan: &'a Plan<'a>,
    pub substep: &'a Substep,
    pub x: &'a [Vec4],
    pub u: &'a mut [Vec4],
    pub push: &'a mut [Vec4],
    /// The square (m²) of the largest correction, as bits.
    pub most: &'a AtomicU32,
}

impl Loop for PushOut<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let PushOut { plan, substep, x, u, push, most } = self;
        let mut farthest = 0.0_f32;
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
                    farthest = farthest.max((at - from).length_squared()).max(f32::MIN_POSITIVE);
                }
            }
        }
        // The bits of numbers that are not negative are in the order of the numbers.
        most.fetch_max(farthest.to_bits(), Ordering::Relaxed);
    }
}

/// Keeps vertices that pairs act on out of the colliders, as far as it changes their displacements.
pub(super) struct Collide<'a> {
    pub plan: &'a Plan<'a>,
    pub substep: &'a Substep,
    pub vertices: &'a [Vertex],
    pub x: &'a [Vec4],
    pub u: &'a mut [Vec4],
}

impl Loop for Collide<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Collide { plan, substep, vertices, x, u } = self;
        for body in plan.bodies {
            let clear = Clear::of(body, substep, plan.params.fraction);
            for first in (0..x.len()).step_by(L::LANES) {
                let end = x.len().min(first + L::LANES);
                if end - first == L::LANES && L::all(clear.of_vertices(loaded::<L>(&x[first..end]), loaded::<L>(&u[first..end])))
                {
                    continue;
                }
                for i in (first..end).filter(|&i| vertices[i].acts()) {
                    u[i] = contact_body(xyz(x[i]), xyz(u[i]), body, substep, &plan.params).1.extend(0.0);
                }
            }
        }
    }
}
