//! The contacts of one substep: its near pairs, their vertices, and the active pairs.

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::acting::Acting;
use super::detection::{Kind, Rows};
use super::near::{Find, Near, Start, Vertex};
use crate::kernels::integrate::xyz;
use crate::simd;

/// Pairs per task.
const GRAIN: usize = 512;

/// The contacts of a substep. The buffers are reused.
#[derive(Debug, Default)]
pub(super) struct Contacts {
    pub pairs: [Vec<Near>; 2],
    pub vertices: Vec<Vertex>,
    /// Positions and displacements (m) of the vertices.
    pub x: Vec<Vec4>,
    pub u: Vec<Vec4>,
    /// The active pairs.
    pub acting: Acting,
    /// Displacements (m) relative to the cloth as a whole, and the share of them that each pair leaves to a vertex.
    pub by: Vec<Vec4>,
    pub cutting: Vec<Vec<(u32, f32)>>,
    /// For each vertex of the cloth, its place among the vertices of near pairs plus one.
    place: Vec<u32>,
    found: Vec<Vec<Near>>,
}

impl Contacts {
    /// Finds the near pairs of the lists, in order, with their multipliers from the last substep times `scale`.
    pub(super) fn gather(&mut self, lists: &mut [Rows; 2], start: Start<'_>, scale: f32) {
        self.find(lists, start);
        self.index(start);
        self.acting.gather(&self.pairs, &mut self.vertices, lists, start, scale);
        // Pairs that are not near have no multipliers.
        lists.iter_mut().for_each(|rows| rows.lambda.fill(Vec4::ZERO));
    }

    pub(super) fn is_empty(&self) -> bool {
        self.pairs.iter().all(Vec::is_empty)
    }

    fn find(&mut self, lists: &[Rows; 2], start: Start<'_>) {
        for kind in Kind::ALL {
            let (rows, pairs) = (&lists[kind as usize], &mut self.pairs[kind as usize]);
            pairs.clear();
            let tasks = rows.pairs.len().div_ceil(GRAIN);
            if !start.is_shared || tasks < 2 {
                simd::run(start.width, Find { kind, first: 0, pairs: &rows.pairs, start: &start, found: pairs });
                continue;
            }
            if self.found.len() < tasks {
                self.found.resize_with(tasks, Vec::new);
            }
            let found = &mut self.found[..tasks];
            found.par_iter_mut().zip(rows.pairs.par_chunks(GRAIN)).enumerate().for_each(|(task, (found, pairs))| {
                found.clear();
                simd::run(start.width, Find { kind, first: task * GRAIN, pairs, start: &start, found });
            });
            found.iter().for_each(|found| pairs.extend_from_slice(found));
        }
    }

    /// Numbers the vertices of near pairs and copies their state.
    fn index(&mut self, start: Start<'_>) {
        self.place.clear();
        self.place.resize(start.x.len(), 0);
        self.pairs.iter().flatten().flat_map(|pair| pair.corners).for_each(|vertex| self.place[vertex as usize] = 1);
        self.vertices.clear();
        self.x.clear();
        self.u.clear();
        for (index, place) in self.place.iter_mut().enumerate().filter(|(_, place)| **place > 0) {
            let (x, u) = (start.x[index], start.u[index].with_w(0.0));
            let push = start.push.get(index).map_or(Vec3A::ZERO, |&push| xyz(push));
            let travel = (xyz(u) + push - start.mean).length();
            let reach = start.surface.reach[index];
            *place = self.vertices.len() as u32;
            self.vertices.push(Vertex { index: index as u32, x, push, weight: 0.0, travel, reach, share: 1.0 });
            self.x.push(x);
            self.u.push(u);
        }
        for pair in self.pairs.iter_mut().flatten() {
            pair.corners = pair.corners.map(|vertex| self.place[vertex as usize]);
        }
    }
}
