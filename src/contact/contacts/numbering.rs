//! The vertices of listed pairs are numbered, so that what contact needs of them lies close together.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::Vec4;

use super::{Contacts, GRAIN};
use crate::contact::contacts::near::approach::{PATCH, PatchMotion};
use crate::contact::contacts::near::portions::{PORTION, Portion};
use crate::contact::detection::rows::Rows;
use crate::contact::ranges::Ranges;
use crate::contact::workers::Workers;
use crate::kernels::pair::Kind;
use crate::model::csr::distinct;

/// The position of a vertex that is not known: see [`Contacts::x`].
const UNKNOWN: Vec4 = Vec4::NEG_ONE;

impl Contacts {
    /// Numbers the vertices of the lists, in order.
    pub(crate) fn number(&mut self, lists: &[Rows; 2], vertices: usize, workers: Workers<'_>) {
        let Contacts { order, place, motions, x, .. } = self;
        place.resize_with(vertices, AtomicU32::default);
        place.iter_mut().for_each(|place| *place.get_mut() = 0);
        motions.resize(vertices.div_ceil(PATCH), PatchMotion::NONE);
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
        x.clear();
        x.resize(order.len(), UNKNOWN);
        (self.numbered, self.used) = ([0; 2], 0);
        self.add(lists, workers);
        self.is_numbered = true;
    }

    /// Numbers the vertices of pairs that have been added to the lists, too.
    pub(crate) fn number_more(&mut self, lists: &[Rows; 2], workers: Workers<'_>) {
        let Contacts { order, place, numbered, portions, used, x, acting, .. } = self;
        let added = lists.iter().zip(*numbered).flat_map(|(rows, numbered)| &rows.pairs[numbered..]);
        let is_new = |vertex: &u32| order.get(place[*vertex as usize].load(Ordering::Relaxed) as usize) != Some(vertex);
        let new: Vec<u32> = distinct(added.flat_map(|pair| pair.corners).filter(is_new).collect());
        if !new.is_empty() {
            let mut count = new.len();
            let mut shifted = vec![0; order.len()];
            order.resize(order.len() + count, 0);
            x.resize(order.len(), UNKNOWN);
            // From the end, so that each moves before its place is taken.
            for old in (0..shifted.len()).rev() {
                let vertex = order[old];
                while count > 0 && new[count - 1] > vertex {
                    count -= 1;
                    (order[old + count + 1], x[old + count + 1]) = (new[count], UNKNOWN);
                }
                (order[old + count], x[old + count], shifted[old]) = (vertex, x[old], (old + count) as u32);
            }
            order[..count].copy_from_slice(&new[..count]);
            x[..count].fill(UNKNOWN);
            (0..).zip(&*order).for_each(|(at, &vertex)| *place[vertex as usize].get_mut() = at);
            let shift =
                |corners: &mut [[u32; 4]]| corners.as_flattened_mut().iter_mut().for_each(|at| *at = shifted[*at as usize]);
            workers.chunks(&mut portions[..*used], 1, |_, portions| {
                for Portion { corners, groups, .. } in portions {
                    shift(corners);
                    groups.iter_mut().for_each(|group| shift(&mut group.block.corners));
                }
            });
            // What else depends on places is made anew.
            acting.ranges = Ranges::default();
        }
        self.add(lists, workers);
    }

    /// Adds the pairs of the lists that are not there yet, whose vertices are numbered.
    fn add(&mut self, lists: &[Rows; 2], workers: Workers<'_>) {
        let Contacts { place, numbered, portions, used, .. } = self;
        let portions_of = |pairs: usize| pairs.div_ceil(PORTION);
        let (before, after) = (portions_of(numbered[0]), portions_of(lists[0].pairs.len()));
        *numbered = lists.each_ref().map(|rows| rows.pairs.len());
        let known = *used;
        *used = after + portions_of(numbered[1]);
        portions.resize_with(portions.len().max(*used), Portion::default);
        portions[known..*used].iter_mut().for_each(Portion::clear);
        // New portions were appended behind those of both lists; those of the first list are rotated to its end.
        portions[before..known + after - before].rotate_right(after - before);
        for (index, portion) in portions[..*used].iter_mut().enumerate() {
            portion.kind = Kind::ALL[usize::from(index >= after)];
            portion.first = PORTION * (index - after * portion.kind as usize);
        }
        let place = |vertex: u32| place[vertex as usize].load(Ordering::Relaxed);
        workers.chunks(&mut portions[..*used], 1, |_, portions| {
            for portion in portions {
                let pairs = &lists[portion.kind as usize].pairs[portion.first..];
                portion.add(&pairs[..pairs.len().min(PORTION)], place);
            }
        });
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_numbering.rs"]
mod tests;
