//! Predicted displacements: bending, wind and spring forces, gathered at each vertex from its neighborhood.

use std::ops::Range;

use glam::Vec3A;

use crate::cpu::bend_filter::{Filter, FilterArrays, FilterMoments, TrialDisplacements};
use crate::cpu::force_batches::{PanelBatches, RingBatches};
use crate::cpu::force_loops::{BendForces, BendMoments, DampedMoments, PanelForces};
use crate::cpu::partition::tile_with;
use crate::cpu::tasks::shared::{SharedArray, Task};
use crate::kernels::integrate::{pin_displacement, xyz};
use crate::kernels::params::Substep;
use crate::kernels::spring::spring_force;
use crate::model::csr::distinct;
use crate::options::Method;
use crate::simd::aligned::AlignedVec;
use crate::simd::{self, Width};
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// Triangles per task of [`Forces::panel_forces`].
const GRAIN: usize = 1024;

/// Arrays of the force stages, kept from step to step. Those of forces that the scene lacks are empty.
#[derive(Debug, Default)]
pub(crate) struct ForceArrays {
    /// The moment of each vertex's bending row ([`bend_moment`](crate::kernels::bending::bend_moment)).
    moments: AlignedVec,
    /// The couple that damping adds to each moment.
    couples: AlignedVec,
    filter: FilterArrays,
    /// A third of the aerodynamic force (N) on each triangle: what each of its corners receives.
    panel_forces: AlignedVec,
    rings: RingBatches,
    panels: PanelBatches,
    /// What the lists were packed for: length of the substep, bending, wind, lanes.
    packed_for: Option<(Length, bool, bool, usize)>,
    /// The tiles of the vertices that each task of [`Forces::panel_forces`] reads.
    pub panel_tiles: Vec<Vec<u32>>,
}

/// The force arrays during a step.
pub(crate) struct Forces<'a> {
    plan: &'a Plan<'a>,
    x: &'a SharedArray<'a>,
    /// Displacements (m): of the last substep until they are predicted, then of this one.
    u: &'a SharedArray<'a>,
    moments: SharedArray<'a>,
    couples: SharedArray<'a>,
    filter: Filter<'a>,
    /// A third of the aerodynamic force (N) on each triangle.
    on_panels: SharedArray<'a>,
    rings: &'a RingBatches,
    panels: &'a PanelBatches,
    width: Width,
}

impl ForceArrays {
    /// Prepares the arrays for a plan's bending and air. `tiles` are the ranges of vertices that the cloth is cut
    /// into.
    pub(crate) fn pack(&mut self, plan: &Plan<'_>, bending: bool, air: bool, tiles: &[Range<u32>], width: Width) {
        let fit = |list: &mut AlignedVec, length: usize| {
            if list.len() != length {
                *list = AlignedVec::new(length);
            }
        };
        let vertices = plan.cloth.rest.len();
        fit(&mut self.moments, if bending { vertices } else { 0 });
        let damped = if bending && plan.damped() { vertices } else { 0 };
        fit(&mut self.couples, damped);
        if bending && !plan.coefficients.bending.passes.is_empty() {
            self.filter.fit(vertices, damped);
        } else {
            self.filter.fit(0, 0);
        }
        fit(&mut self.panel_forces, if air { plan.cloth.panels().panels.len() } else { 0 });
        let scene = (plan.coefficients.length, bending, air, width.lanes());
        if self.packed_for == Some(scene) {
            return;
        }
        self.packed_for = Some(scene);
        // The old lists are dropped before new ones are built, so that memory never holds both.
        (self.rings, self.panels, self.panel_tiles) = Default::default();
        if bending {
            self.rings = RingBatches::new(plan.cloth, &plan.coefficients.bending.rows, plan.cloth.bending(), width.lanes());
        }
        if air {
            let panels = &plan.cloth.panels().panels;
            self.panels = PanelBatches::new(plan.cloth, panels, width.lanes());
            let corners = panels.chunks(GRAIN).map(|panels| panels.iter().flat_map(|panel| panel.corners));
            self.panel_tiles =
                corners.map(|corners| distinct(corners.map(|vertex| tile_with(tiles, vertex)).collect())).collect();
        }
    }

    pub(crate) fn share<'a>(
        &'a mut self,
        plan: &'a Plan<'a>,
        x: &'a SharedArray<'a>,
        u: &'a SharedArray<'a>,
        width: Width,
    ) -> Forces<'a> {
        Forces {
            plan,
            x,
            u,
            moments: SharedArray::new(self.moments.room()),
            couples: SharedArray::new(self.couples.room()),
            filter: self.filter.share(&plan.coefficients.bending.passes),
            on_panels: SharedArray::new(self.panel_forces.room()),
            rings: &self.rings,
            panels: &self.panels,
            width,
        }
    }
}

impl Forces<'_> {
    /// Computes the moments of the bending rows of a tile's vertices from their one-rings.
    pub(crate) fn bend_moments(&self, task: &Task, tile: Range<u32>, substep: &Substep) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        let (moments, groups) = (self.moments.within(task), self.groups(&tile));
        let (rings, filter) = (self.rings, self.filter.pass(task, moments, 0));
        if self.couples.is_empty() {
            simd::run(self.width, BendMoments { rings, groups, x, moments, filter });
        } else {
            let couples = self.couples.within(task);
            simd::run(self.width, DampedMoments { rings, groups, x, u, moments, couples, filter, rate: substep.rate });
        }
    }

    /// Displaces a tile's vertices tentatively under the bending moments computed so far, before a pass of the filter.
    pub(crate) fn trial_displacements(&self, task: &Task, tile: Range<u32>, pass: usize) {
        let (rings, groups, moments) = (self.rings, self.groups(&tile), self.moments.within(task));
        let Some(pass) = self.filter.pass(task, moments, pass) else { return };
        simd::run(self.width, TrialDisplacements { rings, groups, pass });
    }

    /// Runs a pass of the filter: recomputes the moments of a tile's vertices from the tentatively displaced rings.
    pub(crate) fn filter_moments(&self, task: &Task, tile: Range<u32>, pass: usize) {
        let (rings, groups, moments) = (self.rings, self.groups(&tile), self.moments.within(task));
        let Some(pass) = self.filter.pass(task, moments, pass) else { return };
        simd::run(self.width, FilterMoments { rings, groups, pass });
    }

    /// Computes the aerodynamic force on one chunk of triangles.
    pub(crate) fn panel_forces(&self, task: &Task, chunk: usize, substep: &Substep) {
        let (x, u, forces) = (self.x.within(task), self.u.within(task), self.on_panels.within(task));
        let count = self.plan.cloth.panels().panels.len();
        let (first, end) = (chunk * GRAIN, ((chunk + 1) * GRAIN).min(count));
        let groups = first / self.width.lanes()..end.div_ceil(self.width.lanes());
        simd::run(self.width, PanelForces { panels: self.panels, groups, x, u, forces, params: &self.plan.params, substep });
    }

    /// Predicts the displacements of a tile's vertices from the ambient acceleration and the bending moments around
    /// them.
    pub(crate) fn bend(&self, task: &Task, tile: Range<u32>, substep: &Substep) {
        let couples = (!self.couples.is_empty()).then(|| self.couples.within(task));
        let (x, u, moments) = (self.x.within(task), self.u.within(task), self.moments.within(task));
        let groups = self.groups(&tile);
        simd::run(self.width, BendForces { rings: self.rings, groups, x, u, moments, couples, substep });
    }

    /// Adds the wind and spring forces to the displacements of a tile's vertices.
    pub(crate) fn add_air_and_springs(&self, task: &Task, tile: Range<u32>, substep: &Substep) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        // Each force is summed and then added separately, in the order of the GPU's stages, so that fewer roundings
        // differ between the two engines.
        let around = self.plan.air.then(|| (&self.plan.cloth.panels().around, self.on_panels.within(task)));
        let springs = (self.plan.method == Method::Springs).then(|| self.plan.cloth.springs());
        for i in tile {
            let from = x.get(i as usize);
            if from.w == 0.0 {
                continue;
            }
            let (mut by, gain) = (xyz(u.get(i as usize)), from.w * substep.gain);
            if let Some((around, forces)) = around {
                let force = around.of(i).iter().map(|&triangle| xyz(forces.get(triangle as usize)));
                by += force.sum::<Vec3A>() * gain;
            }
            if let Some(springs) = springs {
                let force = springs.of(i).iter().map(|s| spring_force(xyz(x.get(s.other as usize)) - xyz(from), s));
                by += force.sum::<Vec3A>() * gain;
            }
            u.set(i as usize, by.extend(0.0));
        }
    }

    /// Sets the displacements of a tile's pins that follow targets.
    pub(crate) fn move_pins(&self, task: &Task, tile: Range<u32>, substep: &Substep) {
        let (x, u) = (self.x.within(task), self.u.within(task));
        let pins = self.plan.pins;
        let first = pins.partition_point(|pin| pin.vertex < tile.start);
        for pin in pins[first..].iter().take_while(|pin| pin.vertex < tile.end) {
            let by = pin_displacement(pin, xyz(x.get(pin.vertex as usize)), substep);
            u.set(pin.vertex as usize, by.extend(0.0));
        }
    }

    /// The groups of vertices (as many as there are lanes) that cover a tile. Tiles begin at the start of a group.
    fn groups(&self, tile: &Range<u32>) -> Range<usize> {
        tile.start as usize / self.width.lanes()..(tile.end as usize).div_ceil(self.width.lanes())
    }
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_forces.rs"]
mod tests;
