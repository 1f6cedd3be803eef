//! The response: each acting pair is held apart by a multiplier. All multipliers are updated at once (Jacobi
//! iteration). Each vertex then sums the impulses of its pairs in the order of the pairs, so the result does not depend
//! on the number of threads.

use glam::Vec4;
use rayon::prelude::*;

use super::acting::{Acting, GROUPS, Group};
use super::contacts::Contacts;
use super::lanes::{corners_of, scattered};
use super::least;
use super::pairs::between;
use super::rows::Rows;
use crate::kernels::contact::{DEPENETRATION, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{RELAXATION, impulse, step_of_lambda};
use crate::kernels::params::Substep;
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector, Width};
use crate::step::plan::Plan;

/// Iterations of the response per substep.
pub(crate) const ITERATIONS: usize = 4;
/// Share of the last substep's multipliers with which this one starts.
pub(super) const WARM: f32 = 0.9;

impl Contacts {
    /// Moves the vertices of near pairs so that the pairs stay apart by their thickness, with friction, and so that
    /// vertices stay outside the colliders. It starts with the multipliers of the last substep times `scale`.
    pub(super) fn respond(
        &mut self,
        plan: &Plan<'_>,
        substep: &Substep,
        lists: &[Rows; 2],
        scale: f32,
        is_shared: bool,
        width: Width,
    ) {
        if self.acting.groups.is_empty() {
            return;
        }
        let most = DEPENETRATION * plan.params.h;
        self.begin(lists, WARM * scale, most, is_shared, width);
        self.give(plan, substep, true, is_shared);
        for _ in 0..ITERATIONS {
            self.step(is_shared, width);
            self.give(plan, substep, false, is_shared);
        }
    }

    /// Sets the multipliers to those of the last substep times `scale`, which are usually close to the new ones.
    /// Computes their impulses, and the corrections that separate pairs closer than their thickness by at most `most`
    /// (m).
    fn begin(&mut self, lists: &[Rows; 2], scale: f32, most: f32, is_shared: bool, width: Width) {
        let Acting { groups, impulses, pushes, mobility, .. } = &mut self.acting;
        let lanes = GROUPS * MAX_LANES;
        let tasks = groups.par_chunks_mut(GROUPS).zip(impulses.par_chunks_mut(lanes)).zip(pushes.par_chunks_mut(lanes));
        tasks.with_min_len(least(is_shared)).for_each(|((groups, impulses), pushes)| {
            for group in groups.iter_mut() {
                for lane in 0..group.count as usize {
                    let (corners, weights) = (group.corners[lane], group.weights(lane));
                    let of = |k: usize| mobility[corners[k] as usize] * weights[k].abs();
                    let bound = (of(0) + of(1)) + (of(2) + of(3));
                    if bound > 0.0 {
                        group.rate[lane] = RELAXATION / bound;
                        let held = lists[group.kind as usize].lambda[group.listed[lane] as usize];
                        group.warm(lane, held * scale);
                    }
                }
            }
            simd::run(width, Begin { groups, impulses, pushes, most });
        });
    }

    /// Updates the multipliers, and computes the impulses of the pairs.
    fn step(&mut self, is_shared: bool, width: Width) {
        let Contacts { acting: Acting { groups, impulses, .. }, u, .. } = self;
        let tasks = groups.par_chunks_mut(GROUPS).zip(impulses.par_chunks_mut(GROUPS * MAX_LANES));
        let step = |(groups, impulses)| simd::run(width, Step { groups, impulses, u });
        tasks.with_min_len(least(is_shared)).for_each(step);
    }

    /// Applies the impulses to the vertices, then resolves their contact with the colliders. The first time also sums
    /// up the corrections of positions.
    fn give(&mut self, plan: &Plan<'_>, substep: &Substep, is_first: bool, is_shared: bool) {
        let Contacts { acting: Acting { impulses, pushes, corners, ranges, .. }, vertices, u, .. } = self;
        let tasks = u.par_chunks_mut(ranges.len()).zip(vertices.par_chunks_mut(ranges.len())).zip(corners);
        tasks.with_min_len(least(is_shared)).for_each(|((u, vertices), corners)| {
            for (place, (u, vertex)) in u.iter_mut().zip(vertices).enumerate() {
                if vertex.x.w == 0.0 || vertex.weight == 0.0 {
                    continue;
                }
                let mut by = xyz(*u) + corners.sum(impulses, place) * vertex.x.w;
                for body in plan.bodies {
                    by = contact_body(xyz(vertex.x), by, body, substep, &plan.params).1;
                }
                *u = by.extend(0.0);
                if is_first {
                    vertex.push += corners.sum(pushes, place) * vertex.x.w;
                }
            }
        });
    }
}

/// Computes the impulses of the multipliers with which the iteration begins, and the corrections of positions.
struct Begin<'a> {
    groups: &'a [Group],
    impulses: &'a mut [Vec4],
    pushes: &'a mut [Vec4],
    most: f32,
}

impl Loop for Begin<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Begin { groups, impulses, pushes, most } = self;
        let lanes = impulses.chunks_exact_mut(L::LANES).zip(pushes.chunks_exact_mut(L::LANES));
        for (index, (impulses, pushes)) in lanes.enumerate() {
            let (group, first) = (&groups[index * L::LANES / MAX_LANES], index * L::LANES % MAX_LANES);
            let normal = vector::<L>(&group.normal, first);
            let (rub, press) = (vector::<L>(&group.rub, first), number(&group.press, first));
            let depth: L = number(&group.depth, first);
            let most = L::splat(most);
            let depth = L::select(depth.lt(most), depth, most);
            let push = normal * (depth * number(&group.rate, first) * L::splat(1.0 / RELAXATION));
            store_vectors(impulse((rub, press), normal), impulses);
            store_vectors(push, pushes);
        }
    }
}

/// One iteration of the multipliers.
struct Step<'a> {
    groups: &'a mut [Group],
    /// The changes of impulse.
    impulses: &'a mut [Vec4],
    u: &'a [Vec4],
}

impl Loop for Step<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Step { groups, impulses, u } = self;
        for (index, impulses) in impulses.chunks_exact_mut(L::LANES).enumerate() {
            let (group, first) = (&mut groups[index * L::LANES / MAX_LANES], index * L::LANES % MAX_LANES);
            let lanes = first..first + L::LANES;
            let normal = vector::<L>(&group.normal, first);
            let (rub, press) = (vector::<L>(&group.rub, first), number(&group.press, first));
            let weights = group.kind.wide_weights(number(&group.free, first), number(&group.last, first));
            let relative = between(weights, corners_of::<L>(u, &group.corners[lanes.clone()]));
            let (gap, rate, friction) = (number(&group.gap, first), number(&group.rate, first), number(&group.friction, first));
            let (new_rub, new_press) = step_of_lambda((rub, press), normal, gap, relative, rate, friction);
            store(&mut group.rub[0][lanes.clone()], new_rub.x);
            store(&mut group.rub[1][lanes.clone()], new_rub.y);
            store(&mut group.rub[2][lanes.clone()], new_rub.z);
            store(&mut group.press[lanes], new_press);
            store_vectors(impulse((new_rub - rub, new_press - press), normal), impulses);
        }
    }
}

#[inline(always)]
fn store_vectors<L: Registers>(from: Vector<L>, to: &mut [Vec4]) {
    let mut all = [Vec4::ZERO; MAX_LANES];
    scattered(from, &mut all);
    to.copy_from_slice(&all[..L::LANES]);
}

#[inline(always)]
fn number<L: Registers>(of: &[f32; MAX_LANES], first: usize) -> L {
    L::from_slice(&of[first..first + L::LANES])
}

#[inline(always)]
fn vector<L: Registers>(of: &[[f32; MAX_LANES]; 3], first: usize) -> Vector<L> {
    Vector::new(number(&of[0], first), number(&of[1], first), number(&of[2], first))
}

#[inline(always)]
fn store<L: Registers>(to: &mut [f32], from: L) {
    let vectors = from.to_vectors();
    for index in 0..L::VECTORS {
        vectors[index].write_to_slice(&mut to[4 * index..]);
    }
}
