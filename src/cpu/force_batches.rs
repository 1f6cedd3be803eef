//! Bending rings and triangles packed for as many vertices or triangles as there are lanes.

use std::ops::Range;

use crate::cpu::tasks::shared::View;
use crate::cpu::tasks::shared::lists::Places;
use crate::kernels::bending::{BendEntry, BendRow};
use crate::kernels::wind::Panel;
use crate::model::bending::Bending;
use crate::model::cloth::Cloth;
use crate::simd::aligned::AlignedVec;
use crate::simd::{Registers, Vector, vector_of_lane};

/// The rings of groups of vertices, as many vertices as lanes in each.
#[derive(Debug, Default)]
pub(crate) struct RingBatches {
    /// For each group: stiffness, damping, diagonal, inverse mass, lane by lane.
    rows: AlignedVec,
    /// Where each group's neighbors begin, and the last one's end.
    starts: Vec<usize>,
    /// One neighbor of each vertex of a group, an item each. A vertex that has fewer than the others is its own, with no weight.
    neighbors: Vec<Neighbors>,
    /// Coefficients ([`BendEntry`]): forward, backward, lane by lane.
    weights: AlignedVec,
    /// The neighbors that are not one after another, lane by lane.
    listed: Places,
}

/// Where as many vertices as lanes are.
#[derive(Debug, Clone, Copy)]
enum Neighbors {
    /// One after another from here on.
    Row(u32),
    /// As `listed` says from here on.
    Listed(u32),
}

/// What a group of rings knows of itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rings<L> {
    pub stiffness: L,
    /// Stiffness times the retardation time.
    pub damping: L,
    pub diagonal: L,
    pub inverse_mass: L,
}

impl RingBatches {
    pub(crate) fn new(cloth: &Cloth, rows: &[BendRow], bending: &Bending, lanes: usize) -> RingBatches {
        let mut batches = RingBatches { listed: Places::new(cloth.rest.len()), ..RingBatches::default() };
        let mut entries: Vec<Vec<BendEntry>> = vec![Vec::new(); lanes];
        for first in (0..rows.len()).step_by(lanes) {
            let vertex = |lane: usize| first + vector_of_lane(lane, lanes);
            for (lane, entries) in entries.iter_mut().enumerate() {
                let v = vertex(lane);
                entries.clear();
                entries.extend(if v < rows.len() { bending.entries.of(v as u32) } else { &[] });
                // In one order, those of vertices in a row are in rows themselves.
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
    pub(crate) fn group<L: Registers>(&self, group: usize) -> Rings<L> {
        let number = |kind: usize| numbers(&self.rows, 4 * group + kind);
        Rings { stiffness: number(0), damping: number(1), diagonal: number(2), inverse_mass: number(3) }
    }

    /// The neighbors of a group's vertices, as many at a time as there are vertices.
    #[inline(always)]
    pub(crate) fn neighbors(&self, group: usize) -> Range<usize> {
        self.starts[group]..self.starts[group + 1]
    }

    /// Values of some neighbors.
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

/// Groups of as many triangles as lanes. The last repeats its last triangle, with no effect but on what is not used.
#[derive(Debug, Default)]
pub(crate) struct PanelBatches {
    masses: AlignedVec,
    /// Of each group all first corners, all second, all third.
    corners: Places,
}

impl PanelBatches {
    pub(crate) fn new(cloth: &Cloth, panels: &[Panel], lanes: usize) -> PanelBatches {
        let mut batches = PanelBatches { masses: AlignedVec::default(), corners: Places::new(cloth.rest.len()) };
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

    /// Values at a corner of a group's triangles.
    #[inline(always)]
    pub(crate) fn corner<L: Registers>(&self, values: View<'_>, group: usize, corner: usize) -> Vector<L> {
        values.at(&self.corners).vectors((3 * group + corner) * L::LANES)
    }
}

/// As many numbers as lanes, the so manieth of a list of such.
#[inline(always)]
fn numbers<L: Registers>(list: &AlignedVec, index: usize) -> L {
    L::from_slice(&bytemuck::cast_slice(list)[index * L::LANES..(index + 1) * L::LANES])
}
