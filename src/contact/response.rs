//! The response: each acting pair is held apart by a multiplier. All multipliers are updated at once (Jacobi
//! iteration). Each vertex then sums the impulses of its pairs in the order of the pairs, so the result does not depend
//! on the number of threads.

use glam::Vec4;
use rayon::prelude::*;

use super::acting::{Acting, Group};
use super::contacts::Contacts;
use super::detection::between;
use super::lanes::{corners_of, scattered};
use crate::kernels::contact::{DEPENETRATION, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{RELAXATION, impulse, step_of_lambda};
use crate::kernels::params::Substep;
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector, Width};
use crate::step::plan::Plan;

/// Iterations of the response per substep.
pub(crate) const ITERATIONS: usize = 4;
/// Vertices per task, and groups of pairs per task.
pub(super) const GRAIN: usize = 512;
const GROUPS: usize = 32;

impl Contacts {
    /// Moves the vertices of near pairs so that the pairs stay apart by their thickness, with friction, and so that
    /// vertices stay outside the colliders.
    pub(super) fn respond(&mut self, plan: &Plan<'_>, substep: &Substep, is_shared: bool, width: Width) {
        let most = DEPENETRATION * plan.params.h;
        // Warm start with the impulses of the last substep, which are usually close to the new ones.
        self.step(Turn::Warm, is_shared, width);
        self.give(plan, substep, is_shared);
        for _ in 0..ITERATIONS {
            self.step(Turn::Step, is_shared, width);
            self.give(plan, substep, is_shared);
        }
        self.step(Turn::Push { most }, is_shared, width);
        for (index, vertex) in self.vertices.iter_mut().enumerate().filter(|(_, vertex)| vertex.weight > 0.0) {
            vertex.push += self.acting.sum(index) * vertex.x.w;
        }
    }

    /// Updates the multipliers, and computes the impulses of the pairs.
    fn step(&mut self, turn: Turn, is_shared: bool, width: Width) {
        let Contacts { acting: Acting { groups, impulses, .. }, u, .. } = self;
        let step = |(groups, impulses): (&mut [Group], &mut [Vec4])| simd::run(width, Step { groups, impulses, u, turn });
        if is_shared && groups.len() > GROUPS {
            groups.par_chunks_mut(GROUPS).zip(impulses.par_chunks_mut(GROUPS * MAX_LANES)).for_each(step);
        } else {
            step((groups, impulses));
        }
    }

    /// Applies the impulses to the vertices, then resolves their contact with the colliders.
    fn give(&mut self, plan: &Plan<'_>, substep: &Substep, is_shared: bool) {
        let Contacts { acting, vertices, u, .. } = self;
        super::for_chunks(is_shared, u, GRAIN, |first, u| {
            for (index, (u, vertex)) in (first..).zip(u.iter_mut().zip(&vertices[first..])) {
                if vertex.x.w == 0.0 || vertex.weight == 0.0 {
                    continue;
                }
                let mut by = xyz(*u) + acting.sum(index) * vertex.x.w;
                for body in plan.bodies {
                    by = contact_body(xyz(vertex.x), by, body, substep, &plan.params).1;
                }
                *u = by.extend(0.0);
            }
        });
    }
}

/// What a pass over the pairs computes.
#[derive(Debug, Clone, Copy)]
enum Turn {
    /// The impulses of the warm start.
    Warm,
    /// Changes of impulse from one iteration of the multipliers.
    Step,
    /// Corrections of positions, not impulses, that separate pairs closer than their thickness by at most `most` (m).
    Push { most: f32 },
}

struct Step<'a> {
    groups: &'a mut [Group],
    impulses: &'a mut [Vec4],
    u: &'a [Vec4],
    turn: Turn,
}

impl Loop for Step<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Step { groups, impulses, u, turn } = self;
        for (group, impulses) in groups.iter_mut().zip(impulses.chunks_mut(MAX_LANES)) {
            for first in (0..MAX_LANES).step_by(L::LANES) {
                let lanes = first..first + L::LANES;
                let mut places = [group.corners[first]; MAX_LANES];
                places[..L::LANES].copy_from_slice(&group.corners[lanes.clone()]);
                let normal = vector::<L>(&group.normal, first);
                let (rub, press) = (vector::<L>(&group.rub, first), L::from_slice(&group.press[lanes.clone()]));
                let rate = L::from_slice(&group.rate[lanes.clone()]);
                let given = match turn {
                    Turn::Warm => impulse((rub, press), normal),
                    Turn::Step => {
                        let (free, last) = (L::from_slice(&group.free[lanes.clone()]), L::from_slice(&group.last[lanes.clone()]));
                        let weights = group.kind.wide_weights(free, last);
                        let relative = between(weights, corners_of::<L>(u, &places));
                        let (gap, friction) =
                            (L::from_slice(&group.gap[lanes.clone()]), L::from_slice(&group.friction[lanes.clone()]));
                        let (new_rub, new_press) = step_of_lambda((rub, press), normal, gap, relative, rate, friction);
                        let given = impulse((new_rub - rub, new_press - press), normal);
                        store(&mut group.rub[0][lanes.clone()], new_rub.x);
                        store(&mut group.rub[1][lanes.clone()], new_rub.y);
                        store(&mut group.rub[2][lanes.clone()], new_rub.z);
                        store(&mut group.press[lanes.clone()], new_press);
                        given
                    }
                    Turn::Push { most } => {
                        let (depth, most) = (L::from_slice(&group.depth[lanes.clone()]), L::splat(most));
                        normal * (L::select(depth.lt(most), depth, most) * rate * L::splat(1.0 / RELAXATION))
                    }
                };
                let mut all = [Vec4::ZERO; MAX_LANES];
                scattered(given, &mut all);
                impulses[lanes].copy_from_slice(&all[..L::LANES]);
            }
        }
    }
}

#[inline(always)]
fn vector<L: Registers>(of: &[[f32; MAX_LANES]; 3], first: usize) -> Vector<L> {
    let lanes = first..first + L::LANES;
    let (x, y) = (L::from_slice(&of[0][lanes.clone()]), L::from_slice(&of[1][lanes.clone()]));
    Vector::new(x, y, L::from_slice(&of[2][lanes]))
}

#[inline(always)]
fn store<L: Registers>(to: &mut [f32], from: L) {
    let vectors = from.to_vectors();
    for index in 0..L::VECTORS {
        vectors[index].write_to_slice(&mut to[4 * index..]);
    }
}
