//! The contacts of one substep: its near pairs, their vertices, and the active pairs.

pub(super) mod acting;
pub(super) mod carry;
pub(super) mod near;
mod numbering;
pub(super) mod pinches;
pub(super) mod response;
pub(super) mod truncation;
pub(super) mod vertex_pairs;

use std::sync::atomic::AtomicU32;
use std::sync::{Mutex, PoisonError};

use glam::{Vec3A, Vec4};

use super::common_motion::CommonMotion;
use super::contacts::acting::{Acting, for_groups};
use super::contacts::vertex_pairs::SLICE;
use super::detection::rows::Rows;
use super::input::{ContactInput, Vertex};
use super::ranges::Ranges;
use super::workers::Workers;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::Kind;
use crate::simd;
use near::approach::{PatchMotion, patch};
use near::group::Member;
use near::portions::{PORTION, Portion};
use near::voronoi::Around;
use near::{Find, FindAgain};

/// Least number of vertices that are worth a part of a loop.
pub(crate) const GRAIN: usize = 32;

/// The contacts of a substep. The buffers are reused.
#[derive(Debug, Default)]
pub(crate) struct Contacts {
    /// Whether the vertices of the lists are numbered. As long as they are, the multipliers are here, not in the lists.
    pub is_numbered: bool,
    /// The vertices of listed pairs, and the place of each vertex of the cloth among them.
    pub order: Vec<u32>,
    pub place: Vec<AtomicU32>,
    /// How many pairs of each list are in the portions.
    pub numbered: [usize; 2],
    /// How the vertices of each patch move.
    pub motions: Vec<PatchMotion>,
    /// The common motion in the last substep, and the coefficients of friction.
    pub common_motion: CommonMotion,
    friction: Vec<f32>,
    /// The portions of the lists, one list after the other. Those beyond `used` are left from longer lists.
    pub portions: Vec<Portion>,
    pub used: usize,
    pub vertices: Vec<Vertex>,
    /// Positions (m) of the vertices. w: how far (m) the vertex was about to move relative to the common motion; negative if it
    /// was not listed in the last substep.
    pub x: Vec<Vec4>,
    /// Displacements (m) of the vertices. w: [`Surface::allowance`](super::surface::Surface::allowance), until they are changed.
    pub u: Vec<Vec4>,
    /// Displacements (m) relative to the common motion, in its axes. w: 1 if the vertex is kinematic or carried, otherwise 0.
    pub relative: Vec<Vec4>,
    /// The vertices that are carried in this substep, as places.
    pub carried: Vec<u32>,
    /// The share of its displacement that truncation leaves each vertex.
    pub shares: Vec<f32>,
    /// For each vertex the sum of how far (m) it gets beyond planes: see [`Truncation::beyond`](near::portions::Truncation).
    pub beyond: Vec<Vec4>,
    /// The active pairs.
    pub acting: Acting,
}

impl Contacts {
    /// Finds the near pairs of the lists, in order, and the active ones among them.
    pub(super) fn find_near(&mut self, lists: &mut [Rows; 2], input: ContactInput<'_>) {
        let keeps_groups = self.update_numbering(lists, input);
        self.carried.clear();
        self.copy(input);
        self.find(lists, keeps_groups, input);
        self.refresh_groups(keeps_groups, input);
    }

    /// Numbers the vertices of the lists as far as they are not. Returns whether the groups of the last substep remain valid.
    fn update_numbering(&mut self, lists: &mut [Rows; 2], input: ContactInput<'_>) -> bool {
        if self.friction != input.friction {
            self.store_multipliers(lists, input.context.workers);
            self.forget();
            input.friction.clone_into(&mut self.friction);
        }
        let was_numbered = self.is_numbered;
        if !was_numbered {
            self.number(lists, input.x.len(), input.context.workers);
        } else if lists.iter().zip(self.numbered).any(|(rows, numbered)| rows.pairs.len() > numbered) {
            self.number_more(lists, input.context.workers);
        }
        let ranges = Ranges::of(self.order.len(), SLICE, input.context.workers);
        let last_ranges = std::mem::replace(&mut self.acting.ranges, ranges);
        was_numbered && ranges == last_ranges
    }

    /// Finds out which of the pairs in groups act, and sums up the weights of vertices in them.
    fn refresh_groups(&mut self, keeps_groups: bool, input: ContactInput<'_>) {
        let Contacts { portions, used, acting, vertices, x, u, .. } = self;
        let portions = &mut portions[..*used];
        let have_changed = !keeps_groups || portions.iter().any(|portion| !portion.joining.is_empty());
        if have_changed {
            acting.number(portions);
        }
        let around = Around { surface: input.surface, x: input.x, vertices };
        for_groups(portions, (&mut acting.weights, &mut []), input.context.workers, &|kind, _, groups, weights, _: &mut [()]| {
            simd::run(input.context.width, FindAgain { kind, groups, weights, x, u, most_push: input.most_push, around });
        });
        acting.weigh(portions, have_changed, vertices, input.context.workers);
    }

    /// Discards what depends on the lists, because they have changed.
    pub(crate) fn forget(&mut self) {
        self.is_numbered = false;
    }

    pub(crate) fn portions(&self) -> &[Portion] {
        &self.portions[..self.used]
    }

    /// Whether there are near pairs.
    pub(crate) fn has_near(&self) -> bool {
        self.portions().iter().flat_map(Portion::blocks).any(|block| block.near != 0)
    }

    /// How many pairs are near and how many press, after truncation.
    pub(crate) fn counts(&self) -> [u32; 2] {
        self.portions().iter().fold([0; 2], |[near, pressing], of| [near + of.near, pressing + of.pressing])
    }

    /// How many pairs are squeezed.
    pub(crate) fn squeezed(&self) -> usize {
        let is_kinematic = |place: u32| self.vertices[place as usize].x.w == 0.0;
        self.portions().iter().flat_map(|portion| &portion.groups).map(|group| group.squeezed(is_kinematic)).sum()
    }

    /// Copies the state of the vertices, and bounds the motion of each patch.
    fn copy(&mut self, input: ContactInput<'_>) {
        let Contacts { vertices, x, u, relative, order, common_motion, motions, .. } = self;
        vertices.resize(order.len(), Vertex::default());
        [&mut *u, relative].into_iter().for_each(|of| of.resize(order.len(), Vec4::ZERO));
        let last_common_motion = std::mem::replace(common_motion, input.common_motion);
        let part = input.context.workers.part(order.len(), GRAIN);
        let (mut vertices, mut x, mut u, mut order, mut motions) =
            (&mut **vertices, &mut **x, &mut **u, &**order, &mut **motions);
        let mut first = 0;
        let parts = std::iter::from_fn(|| {
            let last = *order.get(..part.min(order.len()))?.last()?;
            // All vertices of a patch are in one part.
            let count = order.partition_point(|&vertex| patch(vertex) <= patch(last));
            let of = first..patch(last) + 1;
            first = of.end;
            let state = (vertices.split_off_mut(..count)?, x.split_off_mut(..count)?, u.split_off_mut(..count)?);
            Some((of.start, order.split_off(..count)?, state, motions.split_off_mut(..of.len())?))
        });
        input.context.workers.each(parts, |(first, order, (vertices, x, u), motions)| {
            let mut state = vertices.iter_mut().zip(x.iter_mut().zip(u));
            for order in order.chunk_by(|&a, &b| patch(a) == patch(b)) {
                let mut all = PatchMotion::NONE;
                for (&index, (vertex, (x, u))) in order.iter().zip(state.by_ref()) {
                    let of = index as usize;
                    let moved = xyz(input.x[of]) - xyz(*x) - last_common_motion.at(xyz(*x));
                    let was_listed = x.w >= 0.0;
                    let base = input.common_motion.at(xyz(input.x[of]));
                    let allowance = input.surface.allowance[of];
                    *u = input.u[of].with_w(allowance);
                    let least = if input.x[of].w > 0.0 { input.max_carry } else { 0.0 };
                    *x = input.x[of].with_w((xyz(*u) - base).length().max(least));
                    let push = input.push.get(of).map_or(Vec3A::ZERO, |&push| xyz(push));
                    let travel = (xyz(*u) + push - base).length().max(least);
                    let free = xyz(*input.free.get(of).unwrap_or(u));
                    *vertex = Vertex { index, x: input.x[of], push, free, weight: 0.0, travel, allowance };
                    all.join(&PatchMotion { moved: if was_listed { [moved; 2] } else { PatchMotion::NONE.moved }, travel: x.w });
                }
                motions[patch(order[0]) - first] = all;
            }
        });
    }

    /// Finds the near pairs among those that have not acted since they were listed. Makes the groups
    /// anew unless it `keeps_groups`.
    fn find(&mut self, lists: &mut [Rows; 2], keeps_groups: bool, input: ContactInput<'_>) {
        let Contacts { motions, portions, used, vertices, x, u, acting, .. } = self;
        let (vertices, x, u, motions, ranges) = (&**vertices, &**x, &**u, &**motions, acting.ranges);
        let around = Around { surface: input.surface, x: input.x, vertices };
        let owner = |vertex: u32| input.surface.owner[vertices[vertex as usize].index as usize];
        let friction = |[a, _, _, d]: [u32; 4]| input.friction[owner(a).max(owner(d)) as usize];
        let member = |kind: Kind, corners: [u32; 4], listed: u32, thickness: f32| {
            let opposite = if kind == Kind::EdgeEdge { around.opposite(corners) } else { [0; 4] };
            Member { corners, opposite, listed, thickness, friction: friction(corners) }
        };
        let mut left = lists.each_mut().map(|Rows { pairs, lambda, .. }| (&**pairs, &mut **lambda));
        let parts = Portion::shared(&mut portions[..*used], input.context.workers).map(|shared| {
            let mut left = left.iter_mut();
            shared.map(|portions| {
                let (pairs, lambda) = left.next()?;
                let count = (portions.len() * PORTION).min(pairs.len());
                Some((portions, pairs.split_off(..count)?, lambda.split_off_mut(..count)?))
            })
        });
        input.context.workers.each(parts, |parts| {
            for (portions, pairs, lambda) in parts.into_iter().flatten() {
                let each = portions.iter_mut().zip(pairs.chunks(PORTION).zip(lambda.chunks_mut(PORTION)));
                for (portion, (pairs, lambda)) in each {
                    portion.bunches.take(portion.kind, pairs, motions.len());
                    portion.bunches.advance(motions, input.most_push, input.surface.thickness);
                    simd::run(input.context.width, Find { x, u, most_push: input.most_push, around, portion });
                    if !portion.joining.is_empty() || !keeps_groups {
                        let kind = portion.kind;
                        portion.join(lambda, |corners, listed, thickness| member(kind, corners, listed, thickness), ranges);
                    }
                    if !keeps_groups {
                        // Pairs that do not act have no multipliers.
                        lambda.fill(Vec4::ZERO);
                    }
                }
            }
        });
    }

    /// Stores the multipliers in the lists.
    pub(crate) fn store_multipliers(&mut self, lists: &mut [Rows; 2], workers: Workers<'_>) {
        if !self.is_numbered {
            return;
        }
        let mut portions = &self.portions[..];
        for kind in Kind::ALL {
            // Pairs that have been added since have no multipliers.
            let lambda = &mut lists[kind as usize].lambda[..self.numbered[kind as usize]];
            let of_kind = portions.split_off(..lambda.len().div_ceil(PORTION)).unwrap_or_default();
            let part = workers.part(of_kind.len(), 1);
            workers.each(of_kind.chunks(part).zip(lambda.chunks_mut(part * PORTION)), |(portions, lambda)| {
                for (portion, lambda) in portions.iter().zip(lambda.chunks_mut(PORTION)) {
                    for group in &portion.groups {
                        for lane in 0..group.count as usize {
                            lambda[group.listed[lane] as usize - portion.first] = group.pair(lane).1;
                        }
                    }
                }
            });
        }
    }

    /// Writes displacements and positions back to the state. `push` are the corrections of positions by colliders;
    /// empty if there are none. Returns the vertices that contact moves elsewhere than they were about to move, and beyond their margins
    /// by [`drift`](crate::contact::detection::paths::Paths::drift), both by more than their allowance: two that do so may get through
    /// each other if they are not listed as a pair.
    pub(crate) fn finish(
        &self,
        [x, u]: [&mut [Vec4]; 2],
        push: &[Vec4],
        drift: impl Fn(usize, Vec3A, Vec3A) -> f32 + Sync,
        workers: Workers<'_>,
    ) -> Vec<u32> {
        let part = workers.part(x.len(), GRAIN);
        let found = Mutex::new(Vec::new());
        let note = |vertex: &Vertex, before: Vec4, after: Vec4| {
            let most = vertex.allowance;
            if xyz(after - before).length_squared() > most * most
                && drift(vertex.index as usize, xyz(vertex.x), xyz(after)) > most
            {
                found.lock().unwrap_or_else(PoisonError::into_inner).push(vertex.index);
            }
        };
        workers.each(x.chunks_mut(part).zip(u.chunks_mut(part)).enumerate(), |(index, (x, u))| {
            let first = index * part;
            let push = &push[first.min(push.len())..(first + x.len()).min(push.len())];
            let place = |vertex: usize| self.order.partition_point(|&near| (near as usize) < vertex);
            let of_task = place(first)..place(first + x.len());
            let mut all = self.vertices[of_task.clone()].iter().zip(&self.u[of_task]).peekable();
            if push.is_empty() {
                for (vertex, by) in all.filter(|(vertex, _)| vertex.x.w > 0.0) {
                    let index = vertex.index as usize - first;
                    note(vertex, u[index], *by);
                    u[index] = by.with_w(u[index].w);
                    x[index] += vertex.push.extend(0.0);
                }
                return;
            }
            for (index, (x, u)) in (first as u32..).zip(x.iter_mut().zip(u)) {
                let near = all.next_if(|(vertex, _)| vertex.index == index).filter(|(vertex, _)| vertex.x.w > 0.0);
                let push = near.map_or(xyz(push[index as usize - first]), |(vertex, _)| vertex.push);
                near.into_iter().for_each(|(vertex, by)| {
                    note(vertex, *u, *by);
                    *u = by.with_w(u.w);
                });
                *x += push.extend(0.0);
            }
        });
        found.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}
