//! The list of stages that make up a substep.

use crate::cpu::coarse::Coarse;
use crate::cpu::partition::Partition;

/// One stage of a substep. Each stage is applied to every part of the cloth; the scheduler lets a part go on to the
/// next stage as soon as the parts that it depends on have finished this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Stage {
    /// Save the state at the step's start, so that a failed step can be undone.
    Remember,
    /// Transfer data to and from the device that predicts the displacements (in the hybrid engine, the GPU).
    Exchange,
    /// Compute the bending moment of each vertex's row from the one-ring around it.
    BendMoments,
    /// Displace the vertices tentatively under the moments computed so far, before the given pass of the Chebyshev
    /// filter that keeps stiff bending stable at few substeps ([`step::bending`](crate::step::bending)).
    TrialDisplacements(usize),
    /// Run that pass of the filter: recompute the moments from the tentatively displaced rings.
    FilterMoments(usize),
    /// Compute the aerodynamic force on each triangle.
    PanelForces,
    /// Predict each vertex's displacement in this substep from its last displacement and the forces on it.
    Predict,
    /// Set the displacements of the pins that follow targets.
    MovePins,
    /// Restrict to the given level: each aggregate gets the mass-weighted averages of its members.
    Restrict(usize),
    /// Restrict and sweep, in a single task, all levels from the given one on, which are too small to share among
    /// threads.
    SmallLevels(usize),
    /// Sweep the edges of a level in one round of its partition (level, round). Before the first round, the corrections
    /// of the coarser levels are prolongated to it.
    SweepLevel(usize, usize),
    /// Prolongate the corrections of the levels to the vertices.
    Correct,
    /// Sweep the cloth's edges in one round of the partition.
    Sweep(usize),
    /// Sweep those edges of that round again that are in closed shells, in reverse order.
    SweepBack(usize),
    /// Apply the tethers of the vertices whose last edge was swept in this round.
    Tether(usize),
    /// Resolve collisions with the analytic colliders and advance the positions, for the vertices whose last edge was
    /// swept in this round. Where no per-vertex force acts, the displacement of the next substep is predicted here too.
    Move(usize),
    /// Advance the positions of all vertices, once contact of triangles has been resolved outside the task graph.
    MoveAfterContact,
}

/// The features of a scene that decide which stages a substep has.
#[expect(clippy::struct_excessive_bools, reason = "a term is there or not")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Terms {
    /// The displacements are predicted by another engine ([`Stage::Exchange`]).
    pub exchanged: bool,
    /// Every free vertex only falls: the ambient acceleration is uniform and no other force acts.
    pub falls: bool,
    pub bending: bool,
    /// Passes of the bending filter; 0 or 1 if there is no filter.
    pub passes: usize,
    pub air: bool,
    pub springs: bool,
    /// Some pins follow targets.
    pub pins: bool,
    /// Coarse levels in use.
    pub levels: usize,
    /// Some edges are in closed shells.
    pub shells: bool,
    pub tethers: bool,
    /// Threads of the pool.
    pub threads: usize,
    /// Contact of triangles is resolved between the sweep and the move, outside the task graph.
    pub contact: bool,
}

/// The stages that run once, before the first substep of a step.
pub(super) fn prologue(terms: Terms) -> Vec<Stage> {
    if terms.falls { vec![Stage::Remember, Stage::Predict] } else { vec![Stage::Remember] }
}

/// The stages of a substep, in order.
///
/// With contact of triangles the list ends before the move: `Cpu::substeps` resolves contact and then runs
/// [`Stage::MoveAfterContact`].
///
/// Where vertices only fall, no stage predicts: the [`prologue`] predicts the first substep's displacements, and
/// [`Stage::Move`] those of each later substep while the vertex is still in a register.
pub(super) fn stages(terms: Terms, partition: &Partition, coarse: &Coarse) -> Vec<Stage> {
    let mut stages = Vec::new();
    // Predict each vertex's displacement from the last one and the forces.
    if terms.exchanged {
        stages.extend([Stage::Exchange, Stage::Predict]);
    } else {
        stages.extend(terms.bending.then_some(Stage::BendMoments));
        stages.extend((1..terms.passes).flat_map(|pass| [Stage::TrialDisplacements(pass), Stage::FilterMoments(pass)]));
        stages.extend(terms.air.then_some(Stage::PanelForces));
        stages.extend((!terms.falls).then_some(Stage::Predict));
    }
    stages.extend(terms.pins.then_some(Stage::MovePins));
    // Correct the displacements by the coarse levels, coarsest first.
    if terms.levels > 0 {
        let shared = coarse.shared();
        stages.extend((0..shared.max(1)).map(Stage::Restrict));
        stages.extend((shared < terms.levels).then_some(Stage::SmallLevels(shared)));
        for level in (0..shared).rev() {
            stages.extend((0..coarse.levels[level].partition.rounds.len()).map(|round| Stage::SweepLevel(level, round)));
        }
        stages.push(Stage::Correct);
    }
    // Sweep the edges, then apply tethers, resolve collisions and move. With contact of triangles, the last two come
    // later.
    let rounds = 0..partition.rounds.len();
    if terms.shells {
        stages.extend(rounds.clone().map(Stage::Sweep));
        stages.extend(rounds.clone().rev().map(Stage::SweepBack));
    }
    for round in rounds {
        stages.extend((!terms.shells).then_some(Stage::Sweep(round)));
        stages.extend(terms.tethers.then_some(Stage::Tether(round)));
        stages.extend((!terms.contact).then_some(Stage::Move(round)));
    }
    stages
}
