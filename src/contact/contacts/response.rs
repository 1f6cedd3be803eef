//! The response: each acting pair is held apart by a multiplier. All multipliers are updated at once (Jacobi
//! iteration). Each vertex then sums the impulses of its pairs in the order of the pairs, so the result does not depend
//! on the number of threads.

use glam::Vec4;

use super::Contacts;
use super::acting::{Acting, for_groups};
use super::vertex_pairs::Sums;
use crate::contact::contacts::near::group::{Group, Weights};
use crate::contact::input::SubstepContext;
use crate::contact::surface::lanes::{corners_of, number, scattered, store, store_vector, vector};
use crate::contact::vertices::Collide;
use crate::kernels::contact::DEPENETRATION;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{RELAXATION, between, held_distance, impulse, separation, step_of_lambda, warm_share};
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector};

/// Iterations of the response per second, but at least and at most so many per substep. A stack's weight spreads by about a sheet
/// per iteration: with 4 in each of 6 substeps per 1/60 s, the lowest of ten sheets that an impact has compressed stay at half
/// their distance.
const ITERATIONS_PER_SECOND: f32 = 2400.0;
const ITERATIONS: [usize; 2] = [4, 8];

/// The number of iterations in a substep of `h` (s).
pub(crate) fn iterations(h: f32) -> usize {
    ((ITERATIONS_PER_SECOND * h).round() as usize).clamp(ITERATIONS[0], ITERATIONS[1])
}

/// The multipliers of a substep are at most so many times those of the last one.
///
/// Divided by the square of its substep, a multiplier is a force. In a very short substep it mostly consists of what ends a small
/// velocity, which is an impulse, and of rounding; as a force in a long substep these would be as many times larger as that is longer,
/// or the square of that. Beside so large an error it is better to begin with too little, which the iterations make up for.
pub(crate) const MOST_GROWTH: f32 = 16.0;

/// The factor on the multipliers of the last substep, of `last` (s), with which one of `h` (s) begins; 0 if there was none.
pub(crate) fn warm_scale(h: f32, last: f32) -> f32 {
    if last > 0.0 { (h / last).powi(2).min(MOST_GROWTH) } else { 0.0 }
}

impl Contacts {
    /// Moves the vertices of near pairs so that the pairs stay apart by their thickness, with friction, and so that
    /// vertices stay outside the colliders. It starts with the multipliers of the last substep times `scale`.
    pub(crate) fn respond(&mut self, context: SubstepContext<'_>, scale: f32) {
        if self.acting.impulses.is_empty() {
            return;
        }
        self.warm_start(context, scale);
        self.apply_impulses(context, true);
        let iterations = iterations(context.plan.params.h);
        for iteration in 1..=iterations {
            self.step(context, iteration == iterations);
            self.apply_impulses(context, false);
        }
    }

    /// Sets the multipliers to those of the last substep times `scale`, which are usually close to the new ones.
    /// Computes their impulses, and the corrections that separate pairs closer than their thickness.
    fn warm_start(&mut self, SubstepContext { plan, workers, width, .. }: SubstepContext<'_>, scale: f32) {
        let most = DEPENETRATION * plan.params.h;
        let Contacts { acting: Acting { impulses, pushes, weights, mobility, .. }, portions, used, .. } = self;
        let warm_start = |_, before: usize, groups: &mut [Group], impulses: &mut [_], pushes: &mut [[Vec4; MAX_LANES]]| {
            let weights = &weights[before..];
            let (impulses, pushes) = (impulses.as_flattened_mut(), pushes.as_flattened_mut());
            simd::run(width, WarmStart { groups, weights, mobility, impulses, pushes, scale, most });
        };
        for_groups(&mut portions[..*used], (impulses, pushes), workers, &warm_start);
    }

    /// Updates the multipliers, in the last iteration without over-relaxation, and computes the impulses of the pairs.
    fn step(&mut self, SubstepContext { workers, width, .. }: SubstepContext<'_>, is_last: bool) {
        let Contacts { acting: Acting { impulses, weights, .. }, portions, used, u, .. } = self;
        let step = |_, before: usize, groups: &mut [Group], impulses: &mut [[Vec4; MAX_LANES]], _: &mut [()]| {
            simd::run(width, Step { groups, weights: &weights[before..], impulses: impulses.as_flattened_mut(), u, is_last });
        };
        for_groups(&mut portions[..*used], (impulses, &mut []), workers, &step);
    }

    /// Applies the impulses to the vertices, then resolves their contact with the colliders. The first time also sums
    /// up the corrections of positions.
    fn apply_impulses(&mut self, SubstepContext { plan, substep, workers, width }: SubstepContext<'_>, is_first: bool) {
        let Contacts { acting: Acting { impulses, pushes, vertex_pairs, ranges, .. }, vertices, x, u, .. } = self;
        let (impulses, pushes) = (impulses.as_flattened(), pushes.as_flattened());
        let state = x.chunks(ranges.len()).zip(u.chunks_mut(ranges.len()));
        workers.each(state.zip(vertices.chunks_mut(ranges.len())).zip(vertex_pairs), |(((x, u), vertices), pairs)| {
            let mut sums = std::mem::take(&mut pairs.sums);
            simd::run(width, Sums { pairs, from: impulses, to: &mut sums });
            let acting = u.iter_mut().zip(&mut *vertices).zip(sums.as_flattened());
            for ((u, vertex), sum) in acting.filter(|((_, vertex), _)| vertex.acts()) {
                vertex.free += xyz(*sum) * vertex.x.w;
                *u = vertex.free.extend(0.0);
            }
            if is_first {
                simd::run(width, Sums { pairs, from: pushes, to: &mut sums });
                for (vertex, sum) in vertices.iter_mut().zip(sums.as_flattened()).filter(|(vertex, _)| vertex.acts()) {
                    vertex.push += xyz(*sum) * vertex.x.w;
                }
            }
            pairs.sums = sums;
            simd::run(width, Collide { plan, substep, vertices, x, u });
        });
    }
}

/// Computes the multipliers with which the iteration begins, their impulses, and the corrections of positions.
struct WarmStart<'a> {
    groups: &'a mut [Group],
    weights: &'a [Weights],
    mobility: &'a [f32],
    impulses: &'a mut [Vec4],
    pushes: &'a mut [Vec4],
    scale: f32,
    most: f32,
}

impl Loop for WarmStart<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let WarmStart { groups, weights, mobility, impulses, pushes, scale, most } = self;
        let (zero, scale, most) = (L::splat(0.0), L::splat(scale), L::splat(most));
        let lanes = impulses.chunks_exact_mut(L::LANES).zip(pushes.chunks_exact_mut(L::LANES));
        for (index, (impulses, pushes)) in lanes.enumerate() {
            let (of, first) = (index * L::LANES / MAX_LANES, index * L::LANES % MAX_LANES);
            let (group, lanes) = (&mut groups[of], first..first + L::LANES);
            let (mut shares, mut kinematic) = ([zero; 4], [zero; 4]);
            for k in 0..4 {
                let mut mobile = [0.0; MAX_LANES];
                for (mobile, corners) in mobile.iter_mut().zip(&group.block.corners[lanes.clone()]) {
                    *mobile = mobility[corners[k] as usize];
                }
                let (mobile, weight) = (number::<L>(&mobile, 0), number::<L>(&weights[of].0[k], first));
                shares[k] = mobile * weight.abs();
                kinematic[k] = L::select(zero.lt(mobile), zero, weight);
            }
            let bound = (shares[0] + shares[1]) + (shares[2] + shares[3]);
            let is_held = zero.lt(bound);
            let rate = L::select(is_held, L::splat(RELAXATION) / bound, zero);
            let (distance, thickness) = (number::<L>(&group.distance, first), number::<L>(&group.thickness, first));
            let gap = distance - held_distance(thickness, kinematic);
            let depth = (zero - gap).max(zero);
            store(&mut group.gap[lanes.clone()], gap.max(zero));
            let scale = scale * warm_share(depth, thickness);
            let (lambda_t, lambda_n) = (vector::<L>(&group.lambda_t, first) * scale, number::<L>(&group.lambda_n, first) * scale);
            let normal = vector::<L>(&group.block.normal, first);
            let along = normal.x * lambda_t.x + normal.y * lambda_t.y + normal.z * lambda_t.z;
            let lambda_t = Vector::select(is_held, lambda_t - normal * along, Vector::zero());
            let lambda_n = L::select(is_held, lambda_n, zero);
            store(&mut group.rate[lanes.clone()], rate);
            store(&mut group.lambda_n[lanes], lambda_n);
            store_vector(&mut group.lambda_t, first, lambda_t);
            let push = normal * (separation(depth, thickness, most) * rate * L::splat(1.0 / RELAXATION));
            store_vectors(impulse((lambda_t, lambda_n), normal), impulses);
            store_vectors(push, pushes);
        }
    }
}

/// One iteration of the multipliers.
struct Step<'a> {
    groups: &'a mut [Group],
    weights: &'a [Weights],
    /// The changes of impulse.
    impulses: &'a mut [Vec4],
    u: &'a [Vec4],
    /// Whether it is the last of the substep, which is not over-relaxed.
    is_last: bool,
}

impl Loop for Step<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Step { groups, weights, impulses, u, is_last } = self;
        // The rate of a pair includes the over-relaxation.
        let share = L::splat(if is_last { 1.0 / RELAXATION } else { 1.0 });
        for (index, impulses) in impulses.chunks_exact_mut(L::LANES).enumerate() {
            let (of, first) = (index * L::LANES / MAX_LANES, index * L::LANES % MAX_LANES);
            let (group, lanes) = (&mut groups[of], first..first + L::LANES);
            let normal = vector::<L>(&group.block.normal, first);
            let (lambda_t, lambda_n) = (vector::<L>(&group.lambda_t, first), number(&group.lambda_n, first));
            let [a, b, c, d] = &weights[of].0;
            let weights = [number(a, first), number(b, first), number(c, first), number(d, first)];
            let relative = between(weights, corners_of::<L>(u, &group.block.corners[lanes.clone()]));
            let (gap, friction) = (number(&group.gap, first), number(&group.friction, first));
            let rate = number::<L>(&group.rate, first);
            let (new_lambda_t, new_lambda_n) =
                step_of_lambda((lambda_t, lambda_n), normal, gap, relative, rate * share, friction);
            store_vector(&mut group.lambda_t, first, new_lambda_t);
            store(&mut group.lambda_n[lanes], new_lambda_n);
            store_vectors(impulse((new_lambda_t - lambda_t, new_lambda_n - lambda_n), normal), impulses);
        }
    }
}

#[inline(always)]
fn store_vectors<L: Registers>(from: Vector<L>, to: &mut [Vec4]) {
    let mut all = [Vec4::ZERO; MAX_LANES];
    scattered(from, &mut all);
    to.copy_from_slice(&all[..L::LANES]);
}
