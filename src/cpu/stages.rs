//! A substep as a list of stages.

use crate::cpu::coarse::Coarse;
use crate::cpu::partition::Partition;

/// What a substep does to every part of the cloth before it goes on to the next stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Stage {
    /// The state is kept, to go back to.
    Remember,
    /// What is predicted elsewhere comes from there.
    Exchange,
    /// Bending rows take the moments of their rings.
    BendMoments,
    /// Vertices give way to them, before a pass of the filter that takes bending in few substeps.
    GiveWay(usize),
    /// That pass: bending rows take the moments of their rings again.
    BendAgain(usize),
    /// Triangles feel the air.
    PanelForces,
    /// Vertices are given the displacement that the last one and the forces predict.
    Predict,
    /// Pins are given theirs.
    LeadPins,
    /// Aggregates of a level are given the averages of what they are made of.
    Restrict(usize),
    /// Levels from this one on, too small to share, are restricted and swept together.
    SmallLevels(usize),
    /// Edges of a level, in one round of its partition, after it was handed what the coarser ones were corrected by.
    SweepLevel(usize, usize),
    /// Vertices are handed what the levels were corrected by.
    Correct,
    /// Edges, in one round of the partition.
    Sweep(usize),
    /// Vertices whose edges are all swept are held by their tethers, after a round of the partition.
    Tether(usize),
    /// Vertices whose edges are all swept meet the colliders and move. Where no force acts they are predicted to fall on.
    Move(usize),
    /// Vertices move, whose contact is done.
    MoveOn,
}

/// What decides which stages a substep has.
#[expect(clippy::struct_excessive_bools, reason = "a term is there or not")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Terms {
    /// Displacements are predicted elsewhere.
    pub exchanged: bool,
    pub bending: bool,
    /// Passes over the bending rows.
    pub passes: usize,
    pub wind: bool,
    pub springs: bool,
    /// Pins are led.
    pub pins: bool,
    pub levels: usize,
    pub tethers: bool,
    pub threads: usize,
    /// Contact is resolved by itself, between the sweep and the move.
    pub contact: bool,
}

impl Terms {
    /// Whether vertices fall: no force acts on them but the ambient acceleration.
    pub(super) fn falls(self) -> bool {
        !(self.exchanged || self.bending || self.wind || self.springs)
    }
}

/// What comes before the first substep of a step.
pub(super) fn prologue(terms: Terms) -> Vec<Stage> {
    if terms.falls() { vec![Stage::Remember, Stage::Predict] } else { vec![Stage::Remember] }
}

/// The stages of a substep, in order.
///
/// Where vertices only fall there is no stage that predicts: the first substep's displacements are predicted in the [`prologue`],
/// and each next one's where a vertex moves ([`Stage::Move`]), while it is at hand.
pub(super) fn stages(terms: Terms, partition: &Partition, coarse: &Coarse) -> Vec<Stage> {
    let mut stages = Vec::new();
    // Predict each vertex's displacement, from the last one and the forces.
    if terms.exchanged {
        stages.extend([Stage::Exchange, Stage::Predict]);
    } else {
        stages.extend(terms.bending.then_some(Stage::BendMoments));
        stages.extend((1..terms.passes).flat_map(|pass| [Stage::GiveWay(pass), Stage::BendAgain(pass)]));
        stages.extend(terms.wind.then_some(Stage::PanelForces));
        stages.extend((!terms.falls()).then_some(Stage::Predict));
    }
    stages.extend(terms.pins.then_some(Stage::LeadPins));
    // Correct it by levels, the coarsest first.
    if terms.levels > 0 {
        let shared = coarse.shared();
        stages.extend((0..shared.max(1)).map(Stage::Restrict));
        stages.extend((shared < terms.levels).then_some(Stage::SmallLevels(shared)));
        for level in (0..shared).rev() {
            stages.extend((0..coarse.partition(level).rounds.len()).map(|round| Stage::SweepLevel(level, round)));
        }
        stages.push(Stage::Correct);
    }
    // Sweep the edges; then tethers, contact, and the move, unless contact comes by itself.
    for round in 0..partition.rounds.len() {
        stages.push(Stage::Sweep(round));
        stages.extend(terms.tethers.then_some(Stage::Tether(round)));
        stages.extend((!terms.contact).then_some(Stage::Move(round)));
    }
    stages
}
