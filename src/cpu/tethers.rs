//! Tethers: each tethered vertex is corrected independently, as many at once as there are SIMD lanes.

use std::ops::Range;

use crate::cpu::partition::Piece;
use crate::cpu::tasks::shared::View;
use crate::cpu::tasks::shared::lists::Indices;
use crate::cpu::tasks::shared::vectors::Four;
use crate::kernels::params::Substep;
use crate::kernels::tether::{Tether, anchor_path, tethered};
use crate::model::csr::distinct;
use crate::simd::aligned::AlignedVec;
use crate::simd::{Loop, Registers};
use crate::step::plan::Plan;

/// The tethers of a round's pieces, packed in batches of one per lane, all of a batch attached to the same pin. Lanes
/// left over repeat the last tether of their batch.
#[derive(Debug, Default)]
pub(crate) struct TetherBatches {
    vertices: Indices,
    /// For each batch, one value per lane: all lengths, then all slacks, then all shares.
    numbers: AlignedVec,
    /// The pin of each batch.
    anchors: Vec<u32>,
    /// The range of batches of each piece.
    of: Vec<Range<usize>>,
}

impl TetherBatches {
    /// Packs `tethers`, sorted by vertex, for the pieces that sweep the last edge of each vertex.
    pub(crate) fn new(pieces: &[Piece], tethers: &[(u32, Tether)], vertices: usize, lanes: usize) -> TetherBatches {
        let mut batches = TetherBatches { vertices: Indices::new(vertices), ..TetherBatches::default() };
        for piece in pieces {
            let first = batches.anchors.len();
            let within = |range: &Range<u32>| {
                let place = |end: u32| tethers.partition_point(|&(vertex, _)| vertex < end) as u32;
                place(range.start)..place(range.end)
            };
            // By anchor, and those of an anchor by vertex.
            let own = piece.vertices.iter().flat_map(within).map(|place| [tethers[place as usize].1.anchor, place]);
            for alike in distinct(own.collect()).chunk_by(|a, b| a[0] == b[0]) {
                alike.chunks(lanes).for_each(|together| batches.push(together, tethers, lanes));
            }
            batches.of.push(first..batches.anchors.len());
        }
        batches.vertices.trim();
        batches.numbers.trim();
        batches
    }

    /// Adds a batch of tethers, given by their anchor and their places.
    fn push(&mut self, together: &[[u32; 2]], tethers: &[(u32, Tether)], lanes: usize) {
        let lane = |lane: usize| &tethers[together[lane.min(together.len() - 1)][1] as usize];
        self.anchors.push(together[0][0]);
        self.vertices.extend((0..lanes).map(|k| lane(k).0));
        self.numbers.push(lanes, |k| lane(k).1.length);
        self.numbers.push(lanes, |k| lane(k).1.slack);
        self.numbers.push(lanes, |k| lane(k).1.share);
    }
}

/// Corrects the displacements `u` (m) of the tethered vertices, at `x` (m), among those whose last edge `piece` has swept.
pub(crate) struct Hold<'t> {
    pub batches: &'t TetherBatches,
    pub piece: usize,
    pub x: View<'t>,
    pub u: View<'t>,
    pub plan: &'t Plan<'t>,
    pub substep: &'t Substep,
}

impl Loop for Hold<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Hold { batches, piece, x, u, plan, substep } = self;
        let (x, u) = (x.at(&batches.vertices), u.at(&batches.vertices));
        let numbers: &[f32] = bytemuck::cast_slice(&batches.numbers);
        let load = L::splat(plan.params.load);
        for batch in batches.of[piece].clone() {
            let first = batch * L::LANES;
            let (lengths, others) = numbers[3 * first..3 * first + 3 * L::LANES].split_at(L::LANES);
            let (slacks, shares) = others.split_at(L::LANES);
            let [from, step] = anchor_path::<L>(&plan.anchors[batches.anchors[batch] as usize], substep, plan.params.fraction);
            let (at, by) = (x.vectors::<L>(first), u.vectors::<L>(first));
            let reach = load.mul_add(L::from_slice(slacks), L::from_slice(lengths));
            let held = L::vectors(by + tethered(at - from, by - step, reach, L::from_slice(shares)));
            let row = u.row::<L>(first);
            for (k, held) in held.into_iter().enumerate() {
                row.set(k, held);
            }
        }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_tethers.rs"]
mod tests;
