//! What each stage of a substep does to one part of the cloth.

use std::ops::Range;

use crate::cpu::correction::Correction;
use crate::cpu::edge_batches::EdgeBatches;
use crate::cpu::forces::Forces;
use crate::cpu::integrate::{AfterMove, Integrator};
use crate::cpu::partition::{Partition, Piece};
use crate::cpu::schedule::{Domain, Pass};
use crate::cpu::stages::{Stage, Terms};
use crate::cpu::sweep::{Rule, SweepRows};
use crate::cpu::tasks::shared::{Task, View};
use crate::cpu::tethers::{Hold, TetherBatches};
use crate::simd;
use crate::step::plan::Plan;

/// The state as one task sees it: positions and displacements.
#[derive(Clone, Copy)]
pub(crate) struct StateView<'t> {
    pub x: View<'t>,
    pub u: View<'t>,
}

/// An engine that predicts the displacements itself, as the hybrid engine does on the GPU.
pub(crate) trait ExternalPrediction: Sync {
    /// Runs before each substep, while no other task runs.
    fn exchange(&self, task: &Task, state: StateView<'_>, substep: usize);

    /// Predicts the displacements of a range of vertices.
    fn predict(&self, state: StateView<'_>, vertices: Range<u32>, substep: usize);

    /// Is told of ranges of vertices that have just been moved.
    fn moved(&self, task: &Task, state: StateView<'_>, vertices: &[Range<u32>], substep: usize);
}

/// All that the tasks of a step need.
pub(crate) struct Stepper<'a> {
    pub plan: &'a Plan<'a>,
    pub terms: Terms,
    pub partition: &'a Partition,
    /// The edges of each round, and those in shells in reverse order.
    pub edges: [&'a [EdgeBatches]; 2],
    pub tethers: &'a [TetherBatches],
    pub forces: Forces<'a>,
    pub correction: Correction<'a>,
    pub integrator: Integrator<'a>,
    pub chunks: Option<&'a [Range<u32>]>,
    pub external: Option<&'a dyn ExternalPrediction>,
    /// How edges are corrected; none if they are springs, which act as forces.
    pub rule: Option<Rule>,
    pub workers: usize,
}

impl Stepper<'_> {
    /// Runs one task: the stages of `pass` on part number `part` of the cloth. A turn is one sweep over the edges, of which a
    /// substep has several under relaxation. Stages before the sweep run in a substep's first turn, those after it in
    /// the last.
    pub(crate) fn work(&self, task: &Task, pass: &Pass, turn: u32, part: usize) {
        let sweeps = self.plan.params.sweeps.max(1);
        let index = (turn / sweeps) as usize;
        let (begins, ends) = (turn.is_multiple_of(sweeps), turn % sweeps + 1 == sweeps);
        for &stage in pass {
            let is_due = match stage {
                Stage::Sweep(_) | Stage::SweepBack(_) => true,
                Stage::Tether(_) | Stage::Move(_) | Stage::MoveAfterContact => ends,
                _ => begins,
            };
            if is_due {
                self.stage(task, stage, index, part);
            }
        }
    }

    fn stage(&self, task: &Task, stage: Stage, index: usize, part: usize) {
        let substep = &self.plan.substeps[index];
        let tile = || match self.chunks {
            Some(chunks) if stage.domain(true) == Domain::Chunks => chunks[part].clone(),
            _ => self.partition.tiles[part].clone(),
        };
        match stage {
            Stage::Remember => self.integrator.remember(task, tile()),
            Stage::Exchange => {
                self.external.into_iter().for_each(|external| external.exchange(task, self.state(task), index));
            }
            Stage::BendMoments => self.forces.bend_moments(task, tile(), substep),
            Stage::TrialDisplacements(pass) => self.forces.trial_displacements(task, tile(), pass),
            Stage::FilterMoments(pass) => self.forces.filter_moments(task, tile(), pass),
            Stage::PanelForces => self.forces.panel_forces(task, part, substep),
            Stage::Predict => self.predict(task, tile(), index),
            Stage::MovePins => self.forces.move_pins(task, tile(), substep),
            Stage::Restrict(level) => self.correction.restrict(task, level, part),
            Stage::SmallLevels(first) => self.correction.small_levels(task, first),
            Stage::SweepLevel(level, round) => self.correction.sweep(task, level, round, part),
            Stage::Correct => self.correction.correct(task, tile()),
            Stage::Sweep(round) => self.sweep(task, round, part, &self.edges[0][round]),
            Stage::SweepBack(round) => self.sweep(task, round, part, &self.edges[1][round]),
            Stage::Tether(round) => {
                let StateView { x, u } = self.state(task);
                let hold = Hold { batches: &self.tethers[round], piece: part, x, u, plan: self.plan, substep };
                simd::run(self.integrator.width, hold);
            }
            Stage::Move(round) => self.advance(task, &self.partition.rounds[round][part].vertices, index),
            Stage::MoveAfterContact => self.advance(task, &[tile()], index),
        }
    }

    fn state<'t>(&'t self, task: &'t Task) -> StateView<'t> {
        StateView { x: self.integrator.x.within(task), u: self.integrator.u.within(task) }
    }

    fn predict(&self, task: &Task, tile: Range<u32>, index: usize) {
        let substep = &self.plan.substeps[index];
        if let Some(external) = self.external {
            return external.predict(self.state(task), tile, index);
        }
        if self.terms.bending {
            self.forces.bend(task, tile.clone(), substep);
        } else {
            self.integrator.fall(task, tile.clone(), substep);
        }
        if self.terms.air || self.terms.springs {
            self.forces.add_air_and_springs(task, tile, substep);
        }
    }

    fn sweep(&self, task: &Task, round: usize, part: usize, edges: &EdgeBatches) {
        let Some(rule) = self.rule else { return };
        let StateView { x, u } = self.state(task);
        let Piece { vertices, touches, .. } = &self.partition.rounds[round][part];
        let worker = |&tile: &u32| tile as usize * self.workers / self.partition.tiles.len();
        // At a border between tiles of two workers, about half of the vertices are in the other core's cache.
        if touches.first().map(worker) != touches.last().map(worker) {
            vertices.iter().for_each(|range| [x, u].iter().for_each(|values| values.claim(range.clone())));
        }
        edges.of(part).for_each(|batch| simd::run(self.integrator.width, SweepRows { rule, batch, x, u, predicted: u }));
    }

    fn advance(&self, task: &Task, vertices: &[Range<u32>], index: usize) {
        let after = match self.plan.substeps.get(index + 1) {
            None => AfterMove::Check,
            Some(next) if self.terms.falls => AfterMove::Fall(next),
            Some(_) => AfterMove::Wait,
        };
        self.integrator.advance(task, vertices, &self.plan.substeps[index], after);
        self.external.into_iter().for_each(|external| external.moved(task, self.state(task), vertices, index));
    }
}
