//! The contacts of one substep: its near pairs, their vertices, and the active pairs.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::{Vec3A, Vec4};

use super::acting::{Acting, for_groups};
use super::corners::SLICE;
use super::frame::Frame;
use super::near::{Find, Look};
use super::pairs::{Kind, Listed};
use super::portions::{Clock, PORTION, Portion};
use super::ranges::Ranges;
use super::rows::Rows;
use super::start::{Start, Vertex};
use super::workers::Workers;
use crate::kernels::integrate::xyz;
use crate::simd;

/// Least number of vertices that are worth a part of a loop.
pub(super) const GRAIN: usize = 32;

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
    /// The share of its displacement that truncation leaves each vertex.
    pub shares: Vec<f32>,
    /// The active pairs.
    pub acting: Acting,
}

impl Contacts {
    /// Finds the near pairs of the lists, in order, and the active ones among them.
    pub(super) fn gather(&mut self, lists: &mut [Rows; 2], start: Start<'_>) {
        if self.friction != start.friction {
            self.keep(lists, start.workers);
            self.forget();
            start.friction.clone_into(&mut self.friction);
        }
        let is_known = self.is_numbered;
        if !is_known {
            self.number(lists, start.x.len(), start.workers);
        }
        let (moved, travel) = self.copy(start);
        self.clock.advance(if is_known { moved } else { 0.0 }, travel, start);
        let ranges = Ranges::of(self.order.len(), SLICE, start.workers);
        let is_known = is_known & (ranges == std::mem::replace(&mut self.acting.ranges, ranges));
        self.find(lists, is_known, start);
        let Contacts { portions, used, acting, vertices, x, u, .. } = self;
        let portions = &mut portions[..*used];
        let have_changed = !is_known || portions.iter().any(|portion| !portion.joining.is_empty());
        if have_changed {
            acting.number(portions);
        }
        for_groups(portions, (&mut acting.weights, &mut []), start.workers, &|kind, _, groups, weights, _: &mut [()]| {
            simd::run(start.width, Look { kind, groups, weights, x, u, most_push: start.most_push });
        });
        acting.weigh(portions, have_changed, vertices, start.workers);
    }

    /// Discards what depends on the lists, because they have changed.
    pub(super) fn forget(&mut self) {
        self.is_numbered = false;
    }

    pub(super) fn portions(&self) -> &[Portion] {
        &self.portions[..self.used]
    }

    /// Whether there are near pairs.
    pub(super) fn has_near(&self) -> bool {
        self.portions().iter().flat_map(Portion::blocks).any(|block| block.near != 0)
    }

    /// How many pairs are near and how many press, after truncation.
    pub(super) fn counts(&self) -> [u32; 2] {
        self.portions().iter().fold([0; 2], |[near, pressing], of| [near + of.near, pressing + of.pressing])
    }

    /// Numbers the vertices of the lists, in order.
    fn number(&mut self, lists: &[Rows; 2], vertices: usize, workers: Workers<'_>) {
        let Contacts { order, place, corners, due, clock, .. } = self;
        *clock = Clock::default();
        place.resize_with(vertices, AtomicU32::default);
        place.iter_mut().for_each(|place| *place.get_mut() = 0);
        for rows in lists {
            let part = workers.part(rows.pairs.len(), GRAIN);
            workers.each(rows.pairs.chunks(part), |pairs| {
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
            let part = workers.part(rows.pairs.len(), GRAIN);
            workers.each(corners.chunks_mut(part).zip(rows.pairs.chunks(part)), |(corners, pairs)| {
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
        let part = start.workers.part(order.len(), GRAIN);
        let parts = vertices.chunks_mut(part).zip(x.chunks_mut(part)).zip(u.chunks_mut(part)).zip(order.chunks(part));
        // The bits of numbers that are not negative are in the order of the numbers.
        let most = [const { AtomicU32::new(0) }; 2];
        start.workers.each(parts, |(((vertices, x), u), order)| {
            let mut farthest = [0.0_f32; 2];
            for (((vertex, x), u), &index) in vertices.iter_mut().zip(x).zip(u).zip(order) {
                let of = index as usize;
                let moved = (xyz(start.x[of]) - xyz(*x) - common.at(xyz(*x))).length_squared();
                let base = start.frame.at(xyz(start.x[of]));
                *u = start.u[of].with_w(0.0);
                *x = start.x[of].with_w((xyz(*u) - base).length());
                let push = start.push.get(of).map_or(Vec3A::ZERO, |&push| xyz(push));
                let travel = (xyz(*u) + push - base).length();
                *vertex = Vertex { index, x: start.x[of], push, weight: 0.0, travel, reach: start.surface.reach[of] };
                farthest = [farthest[0].max(moved), farthest[1].max(x.w)];
            }
            most.iter().zip(farthest).for_each(|(most, far)| _ = most.fetch_max(far.to_bits(), Ordering::Relaxed));
        });
        let [moved, travel] = most.map(|most| f32::from_bits(most.into_inner()));
        (moved.sqrt(), travel)
    }

    /// Looks at pairs that have not acted since they were listed. If the groups are not known, they are made anew.
    fn find(&mut self, lists: &mut [Rows; 2], is_known: bool, start: Start<'_>) {
        let Contacts { corners, due, clock, portions, used, vertices, x, u, acting, .. } = self;
        let (vertices, x, u, clock, ranges) = (&**vertices, &**x, &**u, *clock, acting.ranges);
        let owner = |vertex: u32| start.surface.owner[vertices[vertex as usize].index as usize];
        let friction = |[a, _, _, d]: [u32; 4]| start.friction[owner(a).max(owner(d)) as usize];
        let mut portions = &mut portions[..*used];
        let ([one, other], [of_one, of_other], [due_one, due_other]) = (lists, &*corners, due);
        let mut left = [(one, of_one, due_one), (other, of_other, due_other)].map(|(rows, corners, due)| {
            let Rows { pairs, lambda, .. } = rows;
            let portions = portions.split_off_mut(..pairs.len().div_ceil(PORTION)).unwrap_or_default();
            Piece { portions, pairs, corners, lambda, due }
        });
        let counts = left.each_ref().map(|left| left.portions.len());
        let parts = (0..start.workers.count()).map(|part| {
            let mut counts = counts.iter().map(|count| start.workers.share(part, *count));
            left.each_mut().map(|left| left.take(counts.next().unwrap_or(0)))
        });
        start.workers.each(parts, |parts| {
            parts.into_iter().flat_map(Piece::portions).for_each(|Piece { portions, pairs, corners, lambda, due }| {
                let (portion, most_push) = (&mut portions[0], start.most_push);
                simd::run(start.width, Find { pairs, corners, x, u, due, clock, most_push, portion });
                if !portion.joining.is_empty() || !is_known {
                    portion.join((pairs, corners), lambda, due, friction, ranges);
                }
                if !is_known {
                    // Pairs that do not act have no multipliers.
                    lambda.fill(Vec4::ZERO);
                }
            });
        });
    }

    /// Stores the multipliers in the lists.
    pub(super) fn keep(&mut self, lists: &mut [Rows; 2], workers: Workers<'_>) {
        if !self.is_numbered {
            return;
        }
        let mut portions = &self.portions[..];
        for kind in Kind::ALL {
            let lambda = &mut lists[kind as usize].lambda;
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
    /// empty if there are none.
    pub(super) fn finish(&self, x: &mut [Vec4], u: &mut [Vec4], push: &[Vec4], workers: Workers<'_>) {
        let part = workers.part(x.len(), GRAIN);
        workers.each(x.chunks_mut(part).zip(u.chunks_mut(part)).enumerate(), |(index, (x, u))| {
            let first = index * part;
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

/// Consecutive portions of a list, and what is in them of the arrays that have an item for each pair.
struct Piece<'a> {
    portions: &'a mut [Portion],
    pairs: &'a [Listed],
    corners: &'a [[u32; 4]],
    lambda: &'a mut [Vec4],
    due: &'a mut [f32],
}

impl<'a> Piece<'a> {
    /// Takes at most so many portions off the front.
    fn take(&mut self, portions: usize) -> Piece<'a> {
        let portions = portions.min(self.portions.len());
        let pairs = (portions * PORTION).min(self.pairs.len());
        Piece {
            portions: self.portions.split_off_mut(..portions).unwrap_or_default(),
            pairs: self.pairs.split_off(..pairs).unwrap_or_default(),
            corners: self.corners.split_off(..pairs).unwrap_or_default(),
            lambda: self.lambda.split_off_mut(..pairs).unwrap_or_default(),
            due: self.due.split_off_mut(..pairs).unwrap_or_default(),
        }
    }

    /// The portions one by one.
    fn portions(mut self) -> impl Iterator<Item = Piece<'a>> {
        std::iter::from_fn(move || (!self.portions.is_empty()).then(|| self.take(1)))
    }
}
