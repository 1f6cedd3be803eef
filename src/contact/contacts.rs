//! The contacts of one substep: its near pairs, their vertices, and the active pairs.
//!
//! The lists are divided into portions of a fixed length, and what is found in a portion stays there. So later passes
//! work on portions in parallel, too, and pairs are in the same order on any number of threads.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::acting::Acting;
use super::least;
use super::near::{Find, Portion, Start, Vertex};
use super::pairs::{Kind, Listed};
use super::rows::Rows;
use crate::kernels::integrate::xyz;
use crate::simd;

/// Listed pairs of a portion.
const PORTION: usize = 512;
/// Vertices per task.
pub(super) const GRAIN: usize = 128;

/// The contacts of a substep. The buffers are reused.
#[derive(Debug, Default)]
pub(super) struct Contacts {
    /// Whether the vertices of the lists are numbered.
    is_numbered: bool,
    /// The vertices of listed pairs, and the place of each vertex of the cloth among them.
    order: Vec<u32>,
    place: Vec<AtomicU32>,
    /// The corners of listed pairs of each kind, as places.
    corners: [Vec<[u32; 4]>; 2],
    /// The portions of each kind of pairs. Those beyond `used` are left from longer lists.
    pub portions: [Vec<Portion>; 2],
    pub used: [usize; 2],
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
    pub(super) fn gather(&mut self, lists: &[Rows; 2], start: Start<'_>) {
        if !self.is_numbered {
            self.number(lists, start.x.len(), start.is_shared);
        }
        self.copy(start);
        for kind in Kind::ALL {
            self.find(kind, &lists[kind as usize].pairs, start);
        }
        let Contacts { portions, used, acting, vertices, .. } = self;
        acting.gather([&portions[0][..used[0]], &portions[1][..used[1]]], vertices, start);
    }

    /// Discards what depends on the lists, because they have changed.
    pub(super) fn forget(&mut self) {
        self.is_numbered = false;
    }

    /// The portions of a kind of pairs.
    pub(super) fn portions(&self, kind: Kind) -> &[Portion] {
        &self.portions[kind as usize][..self.used[kind as usize]]
    }

    /// Number of near pairs.
    pub(super) fn near(&self) -> usize {
        Kind::ALL.into_iter().flat_map(|kind| self.portions(kind)).map(|portion| portion.pairs.len()).sum()
    }

    /// Number of pairs that press.
    pub(super) fn pressing(&self) -> u32 {
        Kind::ALL.into_iter().flat_map(|kind| self.portions(kind)).map(|portion| portion.pressing).sum()
    }

    /// Numbers the vertices of the lists, in order.
    fn number(&mut self, lists: &[Rows; 2], vertices: usize, is_shared: bool) {
        let Contacts { order, place, corners, .. } = self;
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
        for (corners, rows) in corners.iter_mut().zip(lists) {
            corners.resize(rows.pairs.len(), [0; 4]);
            let tasks = corners.par_chunks_mut(PORTION).zip(rows.pairs.par_chunks(PORTION));
            tasks.with_min_len(least(is_shared)).for_each(|(corners, pairs)| {
                for (corners, pair) in corners.iter_mut().zip(pairs) {
                    *corners = pair.corners.map(|vertex| place[vertex as usize].load(Ordering::Relaxed));
                }
            });
        }
        self.is_numbered = true;
    }

    /// Copies the state of the vertices.
    fn copy(&mut self, start: Start<'_>) {
        let Contacts { vertices, x, u, by, order, .. } = self;
        vertices.resize(order.len(), Vertex::default());
        [&mut *x, u, by].into_iter().for_each(|of| of.resize(order.len(), Vec4::ZERO));
        let tasks = vertices.par_chunks_mut(GRAIN).zip(x.par_chunks_mut(GRAIN)).zip(u.par_chunks_mut(GRAIN));
        let tasks = tasks.zip(order.par_chunks(GRAIN)).with_min_len(least(start.is_shared));
        tasks.for_each(|(((vertices, x), u), order)| {
            for (((vertex, x), u), &index) in vertices.iter_mut().zip(x).zip(u).zip(order) {
                let of = index as usize;
                *u = start.u[of].with_w(0.0);
                *x = start.x[of].with_w((xyz(*u) - start.mean).length());
                let push = start.push.get(of).map_or(Vec3A::ZERO, |&push| xyz(push));
                let travel = (xyz(*u) + push - start.mean).length();
                *vertex = Vertex { index, x: start.x[of], push, weight: 0.0, travel, reach: start.surface.reach[of], share: 1.0 };
            }
        });
    }

    /// Finds the near pairs of a kind.
    fn find(&mut self, kind: Kind, listed: &[Listed], start: Start<'_>) {
        let Contacts { corners, portions, used, x, u, .. } = self;
        let (corners, portions, used) = (&corners[kind as usize], &mut portions[kind as usize], &mut used[kind as usize]);
        *used = listed.len().div_ceil(PORTION);
        portions.resize_with(portions.len().max(*used), Portion::default);
        let (x, u, portions) = (&**x, &**u, &mut portions[..*used]);
        let tasks = portions.par_iter_mut().zip(listed.par_chunks(PORTION)).zip(corners.par_chunks(PORTION)).enumerate();
        tasks.with_min_len(least(start.is_shared)).for_each(|(index, ((portion, pairs), corners))| {
            let Portion { pairs: found, acting, .. } = portion;
            found.clear();
            let first = index * PORTION;
            simd::run(start.width, Find { kind, first, pairs, corners, x, u, start: &start, found, acting });
        });
        let mut before = 0;
        for portion in portions {
            portion.before = before;
            before += portion.acting.len() as u32;
        }
    }

    /// Stores the multipliers in the lists. Pairs that do not act have none.
    pub(super) fn keep(&mut self, lists: &mut [Rows; 2], is_shared: bool) {
        for kind in Kind::ALL {
            let (portions, acting) = (&mut self.portions[kind as usize][..self.used[kind as usize]], &self.acting);
            let tasks = portions.par_iter_mut().zip(lists[kind as usize].lambda.par_chunks_mut(PORTION)).enumerate();
            tasks.with_min_len(least(is_shared)).for_each(|(index, (portion, lambda))| {
                lambda.fill(Vec4::ZERO);
                portion.pressing = 0;
                let before = portion.before as usize;
                for pair in before..before + portion.acting.len() {
                    let (listed, multiplier) = acting.multiplier(kind, pair);
                    portion.pressing += u32::from(multiplier.w > 0.0);
                    lambda[listed - index * PORTION] = multiplier;
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
