//! A substep as a list of stages, and what each stage does to a tile of the cloth.

use std::ops::Range;

use crate::cpu::coarse::{Coarse, Correction};
use crate::cpu::edge_batches::EdgeBatches;
use crate::cpu::forces::Forces;
use crate::cpu::integrate::{Integrator, Then};
use crate::cpu::partition::{Partition, Piece};
use crate::cpu::sweep::{Rule, sweep};
use crate::cpu::tasks::scheduler::{Graph, PassTasks};
use crate::cpu::tasks::shared::{Task, View};
use crate::cpu::tethers::{TetherBatches, Tethering};
use crate::simd::MAX_LANES;
use crate::step::plan::Plan;

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
    fn falls(self) -> bool {
        !(self.exchanged || self.bending || self.wind || self.springs)
    }
}

/// What comes before the first substep of a step.
fn prologue(terms: Terms) -> Vec<Stage> {
    if terms.falls() { vec![Stage::Remember, Stage::Predict] } else { vec![Stage::Remember] }
}

/// The stages of a substep, in order.
///
/// Where vertices only fall there is no stage that predicts: the first substep's displacements are predicted in the [`prologue`],
/// and each next one's where a vertex moves ([`Stage::Move`]), while it is at hand.
fn stages(terms: Terms, partition: &Partition, coarse: &Coarse) -> Vec<Stage> {
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

/// What the tasks of a stage are over.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Over {
    Everything,
    SmallLevels(usize),
    Tiles,
    /// Parts of tiles.
    Chunks,
    Triangles,
    Aggregates(usize),
    PiecesOfLevel(usize, usize),
    Borders(usize),
}

impl Stage {
    /// Where tiles are too few, what is done to each vertex by itself is done in chunks of them.
    fn over(self, chunks: bool) -> Over {
        match self {
            Stage::Remember
            | Stage::BendMoments
            | Stage::GiveWay(_)
            | Stage::BendAgain(_)
            | Stage::Predict
            | Stage::LeadPins
            | Stage::MoveOn
                if chunks =>
            {
                Over::Chunks
            }
            Stage::Exchange => Over::Everything,
            Stage::SmallLevels(first) => Over::SmallLevels(first),
            Stage::PanelForces => Over::Triangles,
            Stage::Restrict(level) => Over::Aggregates(level),
            Stage::SweepLevel(level, round) => Over::PiecesOfLevel(level, round),
            Stage::Sweep(round) | Stage::Tether(round) | Stage::Move(round) if round > 0 => Over::Borders(round),
            _ => Over::Tiles,
        }
    }

    /// Whether it looks at what a stage before it did to neighbors.
    fn looks_around_after(self, before: Stage) -> bool {
        match before {
            Stage::GiveWay(_) => matches!(self, Stage::BendAgain(_)),
            before => before.is_around() && matches!(self, Stage::GiveWay(_) | Stage::Predict),
        }
    }

    /// Whether it looks at neighbors that others must not go on with meanwhile.
    fn is_around(self) -> bool {
        matches!(self, Stage::BendMoments | Stage::BendAgain(_))
    }
}

/// Stages that are done to a part of the cloth one after another, while it is in cache.
pub(crate) type Pass = Vec<Stage>;

/// Joins stages over the same parts that need nothing of one another's neighbors.
fn fuse(stages: Vec<Stage>, chunks: bool) -> Vec<Pass> {
    let mut passes: Vec<Pass> = Vec::new();
    for stage in stages {
        match passes.last_mut() {
            Some(pass) if pass[0].over(chunks) == stage.over(chunks) && !stage.looks_around_after(pass[0]) => pass.push(stage),
            _ => passes.push(vec![stage]),
        }
    }
    passes
}

/// The passes of a step, and the graph of their tasks.
#[derive(Debug, Default)]
pub(crate) struct Schedule {
    pub passes: Vec<Pass>,
    pub graph: Graph,
    /// Parts of tiles, if those are too few.
    pub chunks: Option<Vec<Range<u32>>>,
}

/// Vertices in a chunk, at least.
const LEAST_CHUNK: usize = 128;

impl Schedule {
    /// The schedules of a step: one, or where contact comes between, that of what comes first, of a substep up to there, and from there on.
    pub(crate) fn all(terms: Terms, partition: &Partition, coarse: &Coarse, panel_tiles: &[Vec<u32>]) -> Vec<Schedule> {
        let schedule = |once, stages| Schedule::new(terms, once, stages, partition, coarse, panel_tiles);
        let stages = stages(terms, partition, coarse);
        match terms.contact {
            false => vec![schedule(prologue(terms), stages)],
            true => [prologue(terms), stages, vec![Stage::MoveOn]].map(|stages| schedule(Vec::new(), stages)).into(),
        }
    }

    fn new(
        terms: Terms,
        first: Vec<Stage>,
        stages: Vec<Stage>,
        partition: &Partition,
        coarse: &Coarse,
        panel_tiles: &[Vec<u32>],
    ) -> Schedule {
        let chunks =
            (partition.tiles.len() < 2 * terms.threads && terms.threads > 1).then(|| chunks(partition, 2 * terms.threads));
        let mut passes = fuse(first, chunks.is_some());
        let once = passes.len();
        passes.extend(fuse(stages, chunks.is_some()));
        let places = Places { partition, coarse, panel_tiles, chunks: chunks.as_deref() };
        let mut tasks: Vec<PassTasks> = Vec::new();
        for (index, pass) in passes.iter().enumerate() {
            let is_local = |over| matches!(over, Over::Tiles | Over::Chunks | Over::Triangles | Over::Borders(_));
            let follows = index > once && is_local(places.over(pass)) && is_local(places.over(&passes[index - 1]));
            tasks.push(PassTasks { touches: places.touched(pass), awaits: places.awaited(pass), follows });
        }
        Schedule { graph: Graph::new(tasks, once, places.count()), passes, chunks }
    }
}

/// The places of the cloth that tasks wait for one another at: its tiles, then those of each level that is shared, then one for all
/// others.
struct Places<'a> {
    partition: &'a Partition,
    coarse: &'a Coarse,
    panel_tiles: &'a [Vec<u32>],
    chunks: Option<&'a [Range<u32>]>,
}

/// Cuts tiles into about so many parts, which begin with whole groups.
fn chunks(partition: &Partition, count: usize) -> Vec<Range<u32>> {
    let vertices = partition.tiles.last().map_or(0, |tile| tile.end as usize);
    let length = (vertices / count).max(LEAST_CHUNK).next_multiple_of(MAX_LANES);
    let of_tile = |tile: &Range<u32>| {
        let Range { start, end } = *tile;
        (start..end).step_by(length).map(move |start| start..end.min(start + length as u32)).collect::<Vec<_>>()
    };
    partition.tiles.iter().flat_map(of_tile).collect()
}

impl Places<'_> {
    fn over(&self, pass: &Pass) -> Over {
        pass[0].over(self.chunks.is_some())
    }

    fn count(&self) -> usize {
        self.first_of_level(self.coarse.shared()) + 1
    }

    fn first_of_level(&self, level: usize) -> usize {
        self.partition.tiles.len() + (0..level).map(|level| self.coarse.partition(level).tiles.len()).sum::<usize>()
    }

    /// The places of some aggregates of a level.
    fn of_level(&self, level: usize, aggregates: impl Iterator<Item = u32>) -> Vec<u32> {
        if level >= self.coarse.shared() {
            return vec![self.count() as u32 - 1];
        }
        let first = self.first_of_level(level) as u32;
        sorted(aggregates.map(|aggregate| first + tile_of(&self.coarse.partition(level).tiles, aggregate)))
    }

    /// What each task of a pass touches.
    fn touched(&self, pass: &Pass) -> Vec<Vec<u32>> {
        let Places { partition, coarse, .. } = *self;
        let tiles = 0..partition.tiles.len() as u32;
        match self.over(pass) {
            Over::Everything => vec![(0..self.count() as u32).collect()],
            // And the level that they are restricted from.
            Over::SmallLevels(first) => {
                vec![(self.first_of_level(first.saturating_sub(1)) as u32..self.count() as u32).collect()]
            }
            Over::Chunks => {
                let tile = |chunk: &Range<u32>| tile_of(&partition.tiles, chunk.start);
                let around = pass[0].is_around();
                let touched = |tile: u32| if around { partition.around[tile as usize].clone() } else { vec![tile] };
                self.chunks.into_iter().flatten().map(|chunk| touched(tile(chunk))).collect()
            }
            Over::Tiles if pass[0].is_around() => partition.around.clone(),
            Over::Tiles => tiles.map(|tile| vec![tile]).collect(),
            Over::Triangles => self.panel_tiles.to_vec(),
            Over::Borders(round) => partition.rounds[round].iter().map(|piece| piece.touches.clone()).collect(),
            Over::Aggregates(level) => {
                let chunks = (0..coarse.restrictions(level)).map(|chunk| coarse.restricted(level, chunk));
                chunks.map(|chunk| self.of_level(level, chunk.map(|aggregate| aggregate as u32))).collect()
            }
            // A piece of the first round is handed down to its whole tile, whatever edges it has.
            Over::PiecesOfLevel(level, 0) => {
                let first = self.first_of_level(level) as u32;
                (0..coarse.partition(level).tiles.len() as u32).map(|tile| vec![first + tile]).collect()
            }
            Over::PiecesOfLevel(level, round) => {
                let first = self.first_of_level(level) as u32;
                let pieces = coarse.partition(level).rounds[round].iter();
                pieces.map(|piece| piece.touches.iter().map(|tile| first + tile).collect()).collect()
            }
        }
    }

    /// Where each task of a pass waits besides.
    ///
    /// What is corrected by a level looks at it. Who next writes there is the restriction to the aggregates that were looked at, and
    /// that waits for what they are made of, which was corrected. What is restricted looks at what is below. Who next writes there
    /// is the correction, and that waits for the aggregates.
    fn awaited(&self, pass: &Pass) -> Vec<Vec<u32>> {
        let Places { partition, coarse, .. } = *self;
        match self.over(pass) {
            Over::Tiles if pass.contains(&Stage::Correct) => {
                let labels = |tile: &Range<u32>| self.of_level(0, coarse.labels(0, tile.clone()));
                partition.tiles.iter().map(labels).collect()
            }
            Over::Aggregates(level) => {
                // From the vertices a task could begin once those of its aggregates are there. But the sweep of
                // the smallest levels waits for all of them anyway, and a worker that has nothing else to do until then would restrict what is in
                // another's cache, rather than help it with the edges.
                let chunks = (0..coarse.restrictions(level)).map(|chunk| coarse.members(level, coarse.restricted(level, chunk)));
                let below = |members| match level {
                    0 => (0..partition.tiles.len() as u32).collect(),
                    _ => self.of_level(level - 1, members),
                };
                chunks.map(below).collect()
            }
            // In the first round a piece, which is a tile's, is handed what the level above was corrected by.
            Over::PiecesOfLevel(level, 0) if level + 1 < coarse.len() => {
                let labels = |tile: &Range<u32>| self.of_level(level + 1, coarse.labels(level + 1, tile.clone()));
                coarse.partition(level).tiles.iter().map(labels).collect()
            }
            _ => Vec::new(),
        }
    }
}

fn sorted(places: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut places: Vec<u32> = places.collect();
    places.sort_unstable();
    places.dedup();
    places
}

fn tile_of(tiles: &[Range<u32>], item: u32) -> u32 {
    tiles.partition_point(|tile| tile.end <= item) as u32
}

/// The state as a task sees it: positions and displacements.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State<'t> {
    pub x: View<'t>,
    pub u: View<'t>,
}

/// A loop over what a task is given, in a substep that is named by its number in the step.
type TaskLoop<'a, T> = dyn Fn(&Task, State<'_>, T, usize) + Sync + 'a;

type MovedLoop<'a> = dyn Fn(&Task, State<'_>, &[Range<u32>], usize) + Sync + 'a;

/// How displacements are predicted elsewhere.
pub(crate) struct Elsewhere<'a> {
    /// Before each substep, while no other task runs.
    pub exchange: &'a TaskLoop<'a, ()>,
    /// Predicts the displacements of some vertices.
    pub predict: &'a TaskLoop<'a, Range<u32>>,
    /// Sees some vertices that were moved.
    pub moved: &'a MovedLoop<'a>,
}

/// A step at work.
pub(crate) struct Stepper<'a> {
    pub plan: &'a Plan<'a>,
    pub terms: Terms,
    pub partition: &'a Partition,
    pub edges: &'a [EdgeBatches],
    pub tethers: &'a [TetherBatches],
    pub tethering: Tethering<'a>,
    pub forces: Forces<'a>,
    pub correction: Correction<'a>,
    pub integrator: Integrator<'a>,
    pub chunks: Option<&'a [Range<u32>]>,
    pub elsewhere: Option<&'a Elsewhere<'a>>,
    /// How edges are corrected, if they are not forces.
    pub rule: Option<Rule>,
    pub workers: usize,
    /// Good steps before this one.
    pub step: u32,
}

impl Stepper<'_> {
    /// One task: the stages of a pass on one part of the cloth. A turn is a sweep, of which a substep may have several.
    pub(crate) fn work(&self, task: &Task, pass: &Pass, turn: u32, index: usize) {
        let sweeps = self.plan.sweeps.max(1);
        let substep = (turn / sweeps) as usize;
        let (begins, ends) = (turn.is_multiple_of(sweeps), turn % sweeps + 1 == sweeps);
        for &stage in pass {
            let is_due = match stage {
                Stage::Sweep(_) => true,
                Stage::Tether(_) | Stage::Move(_) | Stage::MoveOn => ends,
                _ => begins,
            };
            if is_due {
                self.stage(task, stage, substep, index);
            }
        }
    }

    fn stage(&self, task: &Task, stage: Stage, index: usize, part: usize) {
        let substep = &self.plan.substeps[index];
        let tile = || match self.chunks {
            Some(chunks) if stage.over(true) == Over::Chunks => chunks[part].clone(),
            _ => self.partition.tiles[part].clone(),
        };
        match stage {
            Stage::Remember => self.integrator.remember(task, tile()),
            Stage::Exchange => {
                self.elsewhere.into_iter().for_each(|elsewhere| (elsewhere.exchange)(task, self.state(task), (), index));
            }
            Stage::BendMoments => self.forces.bend_moments(task, tile(), substep),
            Stage::GiveWay(pass) => self.forces.give_way(task, tile(), pass),
            Stage::BendAgain(pass) => self.forces.bend_again(task, tile(), pass),
            Stage::PanelForces => self.forces.panel_forces(task, part, substep),
            Stage::Predict => self.predict(task, tile(), index),
            Stage::LeadPins => self.forces.lead_pins(task, tile(), substep),
            Stage::Restrict(level) => self.correction.restrict(task, level, part),
            Stage::SmallLevels(first) => self.correction.small_levels(task, first),
            Stage::SweepLevel(level, round) => self.correction.sweep(task, level, round, part),
            Stage::Correct => self.correction.correct(task, tile()),
            Stage::Sweep(round) => {
                self.sweep(task, round, part);
                if self.terms.contact {
                    self.look_at_edges(task, round, part, index);
                }
            }
            Stage::Tether(round) => self.tethering.hold(task, &self.tethers[round], part, substep),
            Stage::Move(round) => {
                self.look_at_edges(task, round, part, index);
                self.advance(task, &self.partition.rounds[round][part].vertices, index);
            }
            Stage::MoveOn => self.advance(task, &[tile()], index),
        }
    }

    fn state<'t>(&'t self, task: &'t Task) -> State<'t> {
        State { x: self.integrator.x.within(task), u: self.integrator.u.within(task) }
    }

    fn predict(&self, task: &Task, tile: Range<u32>, index: usize) {
        let substep = &self.plan.substeps[index];
        if let Some(elsewhere) = self.elsewhere {
            return (elsewhere.predict)(task, self.state(task), tile, index);
        }
        if self.terms.bending {
            self.forces.bend(task, tile.clone(), substep);
        } else {
            self.integrator.fall(task, tile.clone(), substep);
        }
        if self.terms.wind || self.terms.springs {
            self.forces.blow_and_pull(task, tile, substep);
        }
    }

    fn sweep(&self, task: &Task, round: usize, part: usize) {
        let Some(rule) = self.rule else { return };
        let State { x, u } = self.state(task);
        let Piece { vertices, touches, .. } = &self.partition.rounds[round][part];
        let worker = |&tile: &u32| tile as usize * self.workers / self.partition.tiles.len();
        // At a border between two workers' tiles half of them are in the other's cache.
        if touches.first().map(worker) != touches.last().map(worker) {
            vertices.iter().for_each(|range| [x, u].iter().for_each(|values| values.claim(range.clone())));
        }
        sweep(&self.edges[round], part, rule, x, u, self.integrator.width);
    }

    /// Where the step's last substep leads, some edges are looked at.
    fn look_at_edges(&self, task: &Task, round: usize, part: usize, index: usize) {
        if index + 1 == self.plan.substeps.len() {
            let (State { x, u }, piece) = (self.state(task), &self.partition.rounds[round][part]);
            let longest = self.plan.params.longest;
            self.integrator.found.look_at_edges(self.plan.cloth, piece, self.step, x, u, longest);
        }
    }

    fn advance(&self, task: &Task, vertices: &[Range<u32>], index: usize) {
        let then = match self.plan.substeps.get(index + 1) {
            None => Then::Check,
            Some(next) if self.terms.falls() => Then::Fall(next),
            Some(_) => Then::Wait,
        };
        self.integrator.advance(task, vertices, &self.plan.substeps[index], then);
        self.elsewhere.into_iter().for_each(|elsewhere| (elsewhere.moved)(task, self.state(task), vertices, index));
    }
}
