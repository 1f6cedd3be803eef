//! Bending rings and triangles, packed in groups of as many vertices or triangles as there are SIMD lanes.

use std::ops::Range;

use crate::cpu::tasks::shared::View;
use crate::cpu::tasks::shared::lists::Indices;
use crate::kernels::bending::{BendEntry, BendRow};
use crate::kernels::wind::Panel;
use crate::model::bending::Bending;
use crate::model::cloth::Cloth;
use crate::simd::aligned::AlignedVec;
use crate::simd::{Registers, Vector, vector_of_lane};

/// The one-rings of groups of vertices, with one vertex per lane.
#[derive(Debug, Default)]
pub(crate) struct RingBatches {
    /// Four values for each group, lane by lane: stiffness, damping, diagonal, inverse mass.
    rows: AlignedVec,
    /// Where the neighbors of each group begin in `neighbors`, and at the end the total.
    starts: Vec<usize>,
    /// Each item is one neighbor for every vertex of a group. A vertex with fewer neighbors than others in its group is
    /// padded with itself, with coefficient 0.
    neighbors: Vec<Neighbors>,
    /// The coefficients of each item ([`BendEntry`]): forward, then backward, lane by lane.
    weights: AlignedVec,
    /// The neighbors that are not contiguous in memory, lane by lane.
    listed: Indices,
}

/// Where one neighbor per lane lies in memory.
#[derive(Debug, Clone, Copy)]
enum Neighbors {
    /// Contiguous, from this vertex on.
    Row(u32),
    /// Anywhere: at the indices that `listed` holds from this position on.
    Listed(u32),
}

/// The row values of a group of vertices.
pub(crate) struct RingLanes<L> {
    pub stiffness: L,
    /// Stiffness times the retardation time.
    pub damping: L,
    pub diagonal: L,
    pub inverse_mass: L,
}

impl RingBatches {
    pub(crate) fn new(cloth: &Cloth, rows: &[BendRow], bending: &Bending, lanes: usize) -> RingBatches {
        let mut batches = RingBatches { listed: Indices::new(cloth.rest.len()), ..RingBatches::default() };
        let mut entries: Vec<Vec<BendEntry>> = vec![Vec::new(); lanes];
        for first in (0..rows.len()).step_by(lanes) {
            let vertex = |lane: usize| first + vector_of_lane(lane, lanes);
            for (lane, entries) in entries.iter_mut().enumerate() {
                let v = vertex(lane);
                entries.clear();
                entries.extend(if v < rows.len() { bending.entries.of(v as u32) } else { &[] });
                // Sorted alike, the neighbors of consecutive vertices are often consecutive themselves.
                entries.sort_unstable_by_key(|entry| entry.other);
            }
            batches.starts.push(batches.neighbors.len());
            for index in 0..entries.iter().map(Vec::len).max().unwrap_or(0) {
                let entry = |lane: usize| entries[lane].get(index);
                let itself = |lane: usize| vertex(lane).min(rows.len() - 1) as u32;
                let other = |lane: usize| entry(lane).map_or(itself(lane), |entry| entry.other);
                let in_a_row = (0..lanes).all(|lane| other(lane) == other(0) + vector_of_lane(lane, lanes) as u32);
                batches.neighbors.push(if in_a_row {
                    Neighbors::Row(other(0))
                } else {
                    batches.listed.extend((0..lanes).map(other));
                    Neighbors::Listed((batches.listed.len() - lanes) as u32)
                });
                batches.weights.push(lanes, |lane| entry(lane).map_or(0.0, |entry| entry.forward));
                batches.weights.push(lanes, |lane| entry(lane).map_or(0.0, |entry| entry.backward));
            }
            let row = |lane: usize| rows.get(vertex(lane)).copied().unwrap_or_default();
            batches.rows.push(lanes, |lane| row(lane).stiffness);
            batches.rows.push(lanes, |lane| row(lane).stiffness * row(lane).tau);
            batches.rows.push(lanes, |lane| row(lane).diagonal);
            batches.rows.push(lanes, |lane| cloth.rest.get(vertex(lane)).map_or(0.0, |x| x.w));
        }
        batches.starts.push(batches.neighbors.len());
        batches.rows.trim();
        batches.weights.trim();
        batches.listed.trim();
        batches
    }

    #[inline(always)]
    pub(crate) fn group<L: Registers>(&self, group: usize) -> RingLanes<L> {
        let number = |kind: usize| numbers(&self.rows, 4 * group + kind);
        RingLanes { stiffness: number(0), damping: number(1), diagonal: number(2), inverse_mass: number(3) }
    }

    /// The items of `neighbors` that belong to a group. Each holds one neighbor per lane.
    #[inline(always)]
    pub(crate) fn neighbors(&self, group: usize) -> Range<usize> {
        self.starts[group]..self.starts[group + 1]
    }

    /// The values at one neighbor per lane.
    #[inline(always)]
    pub(crate) fn gather<L: Registers>(&self, values: View<'_>, neighbors: usize) -> Vector<L> {
        match self.neighbors[neighbors] {
            Neighbors::Row(first) => values.vectors(first as usize),
            Neighbors::Listed(first) => values.at(&self.listed).vectors(first as usize),
        }
    }

    #[inline(always)]
    pub(crate) fn forward<L: Registers>(&self, neighbors: usize) -> L {
        numbers(&self.weights, 2 * neighbors)
    }

    #[inline(always)]
    pub(crate) fn backward<L: Registers>(&self, neighbors: usize) -> L {
        numbers(&self.weights, 2 * neighbors + 1)
    }
}

/// Groups of as many triangles as there are lanes. The last group is padded with its last triangle, whose results are
/// not used.
#[derive(Debug, Default)]
pub(crate) struct PanelBatches {
    masses: AlignedVec,
    /// For each group: all first corners, then all second, then all third.
    corners: Indices,
}

impl PanelBatches {
    pub(crate) fn new(cloth: &Cloth, panels: &[Panel], lanes: usize) -> PanelBatches {
        let mut batches = PanelBatches { masses: AlignedVec::default(), corners: Indices::new(cloth.rest.len()) };
        for panels in panels.chunks(lanes) {
            let panel = |lane: usize| panels[vector_of_lane(lane, lanes).min(panels.len() - 1)];
            batches.masses.push(lanes, |lane| panel(lane).mass);
            (0..3).for_each(|corner| batches.corners.extend((0..lanes).map(|lane| panel(lane).corners[corner])));
        }
        batches.masses.trim();
        batches.corners.trim();
        batches
    }

    #[inline(always)]
    pub(crate) fn mass<L: Registers>(&self, group: usize) -> L {
        numbers(&self.masses, group)
    }

    /// The values at one corner of each of a group's triangles.
    #[inline(always)]
    pub(crate) fn corner<L: Registers>(&self, values: View<'_>, group: usize, corner: usize) -> Vector<L> {
        values.at(&self.corners).vectors((3 * group + corner) * L::LANES)
    }
}

/// Slice number `index` of a list of values, one per lane.
#[inline(always)]
fn numbers<L: Registers>(list: &AlignedVec, index: usize) -> L {
    L::from_slice(&bytemuck::cast_slice(list)[index * L::LANES..(index + 1) * L::LANES])
}
