//! The contacts of one substep: its near pairs, their vertices, and the active pairs.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::acting::{Acting, for_portions};
use super::frame::Frame;
use super::least;
use super::near::{Find, Look};
use super::pairs::Kind;
use super::portions::{Clock, PORTION, Portion};
use super::ranges::Ranges;
use super::rows::Rows;
use super::start::{Start, Vertex};
use crate::kernels::integrate::xyz;
use crate::simd;

/// Vertices per task.
pub(super) const GRAIN: usize = 128;

/// The contacts of a substep. The buffers are reused.
#[derive(Debug, Default)]
pub(super) struct Contacts {
    /// Whether the vertices of the lists are numbered. As long as they are, the multipliers are here, not in the lists.
    is_numbered: bool,
    /// The vertices of listed pairs, and the place of each vertex of the cloth among them.
    order: Vec<u32>,
    place: Vec<AtomicU32>,
    /// The corners of listed pairs of each kind, as places, and when the pairs are due.
    corners: [Vec<[u32; 4]>; 2],
    due: [Vec<f32>; 2],
    clock: Clock,
    /// The common motion in the last substep, and the coefficients of friction.
    frame: Frame,
    friction: Vec<f32>,
    /// The portions of the lists, one list after the other. Those beyond `used` are left from longer lists.
    pub portions: Vec<Portion>,
    pub used: usize,
    pub vertices: Vec<Vertex>,
    /// Positions and displacements (m) of the vertices, and displacements relative to the cloth as a whole. The w of a
    /// position is the length of that displacement at the start, that of the last is 1 if the vertex is led.
    pub x: Vec<Vec4>,
    pub u: Vec<Vec4>,
    pub by: Vec<Vec4>,
    /// The active pairs.
    pub acting: Acting,
}

impl Contacts {
    /// Finds the near pairs of the lists, in order, and the active ones among them.
    pub(super) fn gather(&mut self, lists: &mut [Rows; 2], start: Start<'_>) {
        if self.friction != start.friction {
            self.keep(lists, start.is_shared);
            self.forget();
            start.friction.clone_into(&mut self.friction);
        }
        let is_known = self.is_numbered;
        if !is_known {
            self.number(lists, start.x.len(), start.is_shared);
        }
        let (moved, travel) = self.copy(start);
        self.clock.advance(if is_known { moved } else { 0.0 }, travel, start);
        let ranges = Ranges::of(self.order.len(), start.is_shared);
        let is_known = is_known & (ranges == std::mem::replace(&mut self.acting.ranges, ranges));
        self.find(lists, is_known, start);
        let Contacts { portions, used, acting, vertices, x, u, .. } = self;
        let portions = &mut portions[..*used];
        let have_changed = !is_known || portions.iter().any(|portion| !portion.joining.is_empty());
        if have_changed {
            acting.number(portions);
        }
        for_portions(portions, (&mut acting.weights, &mut []), start.is_shared, &|portion, weights, _: &mut [()]| {
            let Portion { kind, groups, .. } = portion;
            simd::run(start.width, Look { kind: *kind, groups, weights, x, u, most_push: start.most_push });
        });
        acting.weigh(portions, have_changed, vertices, start.is_shared);
    }

    /// Discards what depends on the lists, because they have changed.
    pub(super) fn forget(&mut self) {
        self.is_numbered = false;
    }

    fn portions(&self) -> &[Portion] {
        &self.portions[..self.used]
    }

    /// Number of near pairs.
    pub(super) fn near(&self) -> usize {
        self.portions().iter().flat_map(Portion::blocks).map(|block| block.near.count_ones() as usize).sum()
    }

    /// Number of pairs that press.
    pub(super) fn pressing(&self) -> u32 {
        self.portions().iter().flat_map(|portion| &portion.groups).map(|group| group.pressing() as u32).sum()
    }

    /// Numbers the vertices of the lists, in order.
    fn number(&mut self, lists: &[Rows; 2], vertices: usize, is_shared: bool) {
        let Contacts { order, place, corners, due, clock, .. } = self;
        *clock = Clock::default();
        place.resize_with(vertices, AtomicU32::default);
        place.iter_mut().for_each(|place| *place.get_mut() = 0);
        for rows in lists {
            rows.pairs.par_chunks(PORTION).with_min_len(least(is_shared)).for_each(|pairs| {
                for &vertex in pairs.iter().flat_map(|pair| &pair.corners) {
                    let mark = &place[vertex as usize];
                    // Writing takes longer if other threads read.
                    if mark.load(Ordering::Relaxed) == 0 {
                        mark.store(1, Ordering::Relaxed);
                    }
                }
            });
        }
        order.clear();
        for (index, place) in (0..).zip(place.iter_mut().map(AtomicU32::get_mut)).filter(|(_, place)| **place > 0) {
            *place = order.len() as u32;
            order.push(index);
        }
        for ((corners, due), rows) in corners.iter_mut().zip(due).zip(lists) {
            due.clear();
            due.resize(rows.pairs.len(), f32::NEG_INFINITY);
            corners.resize(rows.pairs.len(), [0; 4]);
            let tasks = corners.par_chunks_mut(PORTION).zip(rows.pairs.par_chunks(PORTION));
            tasks.with_min_len(least(is_shared)).for_each(|(corners, pairs)| {
                for (corners, pair) in corners.iter_mut().zip(pairs) {
                    *corners = pair.corners.map(|vertex| place[vertex as usize].load(Ordering::Relaxed));
                }
            });
        }
        let of_kinds = lists.each_ref().map(|rows| rows.pairs.len().div_ceil(PORTION));
        self.used = of_kinds[0] + of_kinds[1];
        self.portions.resize_with(self.portions.len().max(self.used), Portion::default);
        for (index, portion) in self.portions[..self.used].iter_mut().enumerate() {
            portion.kind = Kind::ALL[usize::from(index >= of_kinds[0])];
            portion.first = PORTION * (index - of_kinds[0] * portion.kind as usize);
            portion.groups.clear();
        }
        self.is_numbered = true;
    }

    /// Copies the state of the vertices. Returns by how much (m) they moved at most since the last substep, and will move
    /// at most, relative to the common motions.
    fn copy(&mut self, start: Start<'_>) -> (f32, f32) {
        let Contacts { vertices, x, u, by, order, frame, .. } = self;
        vertices.resize(order.len(), Vertex::default());
        [&mut *x, u, by].into_iter().for_each(|of| of.resize(order.len(), Vec4::ZERO));
        let common = std::mem::replace(frame, start.frame);
        let tasks = vertices.par_chunks_mut(GRAIN).zip(x.par_chunks_mut(GRAIN)).zip(u.par_chunks_mut(GRAIN));
        let tasks = tasks.zip(order.par_chunks(GRAIN)).with_min_len(least(start.is_shared));
        let most = tasks.map(|(((vertices, x), u), order)| {
            let mut most = Vec4::ZERO;
            for (((vertex, x), u), &index) in vertices.iter_mut().zip(x).zip(u).zip(order) {
                let of = index as usize;
                let moved = (xyz(start.x[of]) - xyz(*x) - common.at(xyz(*x))).length_squared();
                let base = start.frame.at(xyz(start.x[of]));
                *u = start.u[of].with_w(0.0);
                *x = start.x[of].with_w((xyz(*u) - base).length());
                let push = start.push.get(of).map_or(Vec3A::ZERO, |&push| xyz(push));
                let travel = (xyz(*u) + push - base).length();
                *vertex = Vertex { index, x: start.x[of], push, weight: 0.0, travel, reach: start.surface.reach[of], share: 1.0 };
                most = most.max(Vec4::new(moved, x.w, 0.0, 0.0));
            }
            most
        });
        let most = most.reduce(|| Vec4::ZERO, Vec4::max);
        (most.x.sqrt(), most.y)
    }

    /// Looks at pairs that have not acted since they were listed. If the groups are not known, they are made anew.
    fn find(&mut self, lists: &mut [Rows; 2], is_known: bool, start: Start<'_>) {
        let Contacts { corners, due, clock, portions, vertices, x, u, acting, .. } = self;
        let (vertices, x, u, clock, ranges) = (&**vertices, &**x, &**u, *clock, acting.ranges);
        let owner = |vertex: u32| start.surface.owner[vertices[vertex as usize].index as usize];
        let friction = |[a, _, _, d]: [u32; 4]| start.friction[owner(a).max(owner(d)) as usize];
        let mut portions = &mut portions[..];
        for kind in Kind::ALL {
            let (Rows { pairs, lambda, .. }, corners) = (&mut lists[kind as usize], &corners[kind as usize]);
            let of_kind = portions.split_off_mut(..pairs.len().div_ceil(PORTION)).unwrap_or_default();
            let tasks = of_kind.par_iter_mut().zip(pairs.par_chunks(PORTION)).zip(corners.par_chunks(PORTION));
            let tasks = tasks.zip(lambda.par_chunks_mut(PORTION)).zip(due[kind as usize].par_chunks_mut(PORTION));
            tasks.with_min_len(least(start.is_shared)).for_each(|((((portion, pairs), corners), lambda), due)| {
                let most_push = start.most_push;
                simd::run(start.width, Find { pairs, corners, x, u, due, clock, most_push, portion });
                if !portion.joining.is_empty() || !is_known {
                    portion.join((pairs, corners), lambda, due, friction, ranges);
                }
                if !is_known {
                    // Pairs that do not act have no multipliers.
                    lambda.fill(Vec4::ZERO);
                }
            });
        }
    }

    /// Stores the multipliers in the lists.
    pub(super) fn keep(&mut self, lists: &mut [Rows; 2], is_shared: bool) {
        if !self.is_numbered {
            return;
        }
        let mut portions = &self.portions[..];
        for kind in Kind::ALL {
            let lambda = &mut lists[kind as usize].lambda;
            let of_kind = portions.split_off(..lambda.len().div_ceil(PORTION)).unwrap_or_default();
            let tasks = of_kind.par_iter().zip(lambda.par_chunks_mut(PORTION)).with_min_len(least(is_shared));
            tasks.for_each(|(portion, lambda)| {
                for group in &portion.groups {
                    for lane in 0..group.count as usize {
                        lambda[group.listed[lane] as usize - portion.first] = group.pair(lane).1;
                    }
                }
            });
        }
    }

    /// Writes displacements and positions back to the state. `push` are the corrections of positions by colliders;
    /// empty if there are none.
    pub(super) fn finish(&self, x: &mut [Vec4], u: &mut [Vec4], push: &[Vec4], is_shared: bool) {
        let tasks = x.par_chunks_mut(GRAIN).zip(u.par_chunks_mut(GRAIN)).enumerate();
        tasks.with_min_len(least(is_shared)).for_each(|(task, (x, u))| {
            let first = task * GRAIN;
            let push = &push[first.min(push.len())..(first + x.len()).min(push.len())];
            let place = |vertex: usize| self.order.partition_point(|&near| (near as usize) < vertex);
            let of_task = place(first)..place(first + x.len());
            let mut near = self.vertices[of_task.clone()].iter().zip(&self.u[of_task]).peekable();
            if push.is_empty() {
                for (vertex, by) in near.filter(|(vertex, _)| vertex.x.w > 0.0) {
                    let index = vertex.index as usize - first;
                    u[index] = by.with_w(u[index].w);
                    x[index] += vertex.push.extend(0.0);
                }
                return;
            }
            for (index, (x, u)) in (first as u32..).zip(x.iter_mut().zip(u)) {
                let found = near.next_if(|(vertex, _)| vertex.index == index).filter(|(vertex, _)| vertex.x.w > 0.0);
                let push = found.map_or(xyz(push[index as usize - first]), |(vertex, _)| vertex.push);
                found.into_iter().for_each(|(_, by)| *u = by.with_w(u.w));
                *x += push.extend(0.0);
            }
        });
    }
}
