//! Groups the stages of a substep into passes, and states which parts of the cloth each task of a pass accesses and
//! waits for.

use std::ops::Range;

use crate::cpu::coarse::Coarse;
use crate::cpu::partition::{Partition, tile_with};
use crate::cpu::stages::{Stage, Terms, prologue, stages};
use crate::cpu::tasks::scheduler::{Graph, PassTasks};
use crate::model::csr::distinct;
use crate::simd::MAX_LANES;

/// What the tasks of a stage iterate over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Domain {
    /// A single task with exclusive access to the whole cloth.
    Everything,
    /// A single task for all levels from this one on.
    SmallLevels(usize),
    Tiles,
    /// Parts of tiles, used when there are too few tiles to occupy all threads.
    Chunks,
    Triangles,
    /// Groups of aggregates of a level that are restricted together.
    Aggregates(usize),
    /// Pieces of a level's partition in one round (level, round).
    PiecesOfLevel(usize, usize),
    /// Pieces of the cloth's partition in one of the rounds after the first.
    Borders(usize),
}

impl Stage {
    /// What the tasks of this stage iterate over. With `chunks`, stages that treat each vertex independently use chunks
    /// instead of tiles.
    pub(super) fn domain(self, chunks: bool) -> Domain {
        match self {
            Stage::Remember
            | Stage::BendMoments
            | Stage::TrialDisplacements(_)
            | Stage::FilterMoments(_)
            | Stage::Predict
            | Stage::MovePins
            | Stage::MoveAfterContact
                if chunks =>
            {
                Domain::Chunks
            }
            Stage::Exchange => Domain::Everything,
            Stage::SmallLevels(first) => Domain::SmallLevels(first),
            Stage::PanelForces => Domain::Triangles,
            Stage::Restrict(level) => Domain::Aggregates(level),
            Stage::SweepLevel(level, round) => Domain::PiecesOfLevel(level, round),
            Stage::Sweep(round) | Stage::SweepBack(round) | Stage::Tether(round) | Stage::Move(round) if round > 0 => {
                Domain::Borders(round)
            }
            _ => Domain::Tiles,
        }
    }

    /// Whether this stage reads what the stage `before` wrote at neighboring vertices. Such stages must not share a
    /// pass.
    fn reads_neighbors_of(self, before: Stage) -> bool {
        match before {
            Stage::TrialDisplacements(_) => matches!(self, Stage::FilterMoments(_)),
            before => before.reads_neighbors() && matches!(self, Stage::TrialDisplacements(_) | Stage::Predict),
        }
    }

    /// Whether this stage reads positions or displacements at neighboring vertices, so that its task must also reserve
    /// the tiles around its own.
    fn reads_neighbors(self) -> bool {
        matches!(self, Stage::BendMoments | Stage::FilterMoments(_))
    }
}

/// Stages that a task runs on its part of the cloth one after another, while that part is in cache.
pub(crate) type Pass = Vec<Stage>;

/// Fuses consecutive stages into passes, if they iterate over the same parts and none reads what another wrote at
/// neighboring vertices.
fn fuse(stages: Vec<Stage>, chunks: bool) -> Vec<Pass> {
    let mut passes: Vec<Pass> = Vec::new();
    for stage in stages {
        match passes.last_mut() {
            Some(pass) if pass[0].domain(chunks) == stage.domain(chunks) && !stage.reads_neighbors_of(pass[0]) => {
                pass.push(stage);
            }
            _ => passes.push(vec![stage]),
        }
    }
    passes
}

/// The passes of a step and the dependency graph of their tasks.
#[derive(Debug, Default)]
pub(crate) struct Schedule {
    pub passes: Vec<Pass>,
    pub graph: Graph,
    /// The chunks that tiles are split into, if there are too few tiles.
    pub chunks: Option<Vec<Range<u32>>>,
}

/// What a schedule covers, as an index of [`Schedule::all`].
pub(crate) enum Part {
    /// What comes before the substeps, and without contact of triangles the substeps, too.
    Prologue,
    /// A substep up to contact of triangles, which runs outside the graphs.
    Substep,
    /// The move after it.
    Move,
}

/// Minimum number of vertices in a chunk.
const MIN_CHUNK: usize = 128;

impl Schedule {
    /// The schedules of a step: one for each [`Part`], or without contact of triangles only the first.
    pub(crate) fn all(terms: Terms, partition: &Partition, coarse: &Coarse, panel_tiles: &[Vec<u32>]) -> Vec<Schedule> {
        let chunks =
            (partition.tiles.len() < 2 * terms.threads && terms.threads > 1).then(|| chunks(partition, 2 * terms.threads));
        let resources = Resources { partition, coarse, panel_tiles, chunks: chunks.as_deref() };
        let schedule = |once, stages| Schedule::new(&resources, once, stages);
        let stages = stages(terms, partition, coarse);
        if terms.contact {
            [prologue(terms), stages, vec![Stage::MoveAfterContact]].map(|stages| schedule(Vec::new(), stages)).into()
        } else {
            vec![schedule(prologue(terms), stages)]
        }
    }

    fn new(resources: &Resources<'_>, first: Vec<Stage>, stages: Vec<Stage>) -> Schedule {
        let mut passes = fuse(first, resources.chunks.is_some());
        let once = passes.len();
        passes.extend(fuse(stages, resources.chunks.is_some()));
        let mut tasks: Vec<PassTasks> = Vec::new();
        for (index, pass) in passes.iter().enumerate() {
            let is_local = |domain| matches!(domain, Domain::Tiles | Domain::Chunks | Domain::Triangles | Domain::Borders(_));
            let follows = index > once && is_local(resources.domain(pass)) && is_local(resources.domain(&passes[index - 1]));
            tasks.push(PassTasks { touches: resources.touched(pass), awaits: resources.awaited(pass), follows });
        }
        Schedule { graph: Graph::new(tasks, once, resources.count()), passes, chunks: resources.chunks.map(<[_]>::to_vec) }
    }
}

/// The resources that tasks wait for one another at. They are numbered: first the cloth's tiles, then the tiles of each
/// level whose sweep is shared, and last a single one for all smaller levels.
struct Resources<'a> {
    partition: &'a Partition,
    coarse: &'a Coarse,
    panel_tiles: &'a [Vec<u32>],
    chunks: Option<&'a [Range<u32>]>,
}

/// Splits the tiles into about `count` chunks, each of which starts at a multiple of the SIMD width.
fn chunks(partition: &Partition, count: usize) -> Vec<Range<u32>> {
    let vertices = partition.tiles.last().map_or(0, |tile| tile.end as usize);
    let length = (vertices / count).max(MIN_CHUNK).next_multiple_of(MAX_LANES);
    let of_tile = |tile: &Range<u32>| {
        let Range { start, end } = *tile;
        (start..end).step_by(length).map(move |start| start..end.min(start + length as u32)).collect::<Vec<_>>()
    };
    partition.tiles.iter().flat_map(of_tile).collect()
}

impl Resources<'_> {
    fn domain(&self, pass: &Pass) -> Domain {
        pass[0].domain(self.chunks.is_some())
    }

    fn count(&self) -> usize {
        self.first_of_level(self.coarse.shared()) + 1
    }

    fn first_of_level(&self, level: usize) -> usize {
        self.partition.tiles.len() + (0..level).map(|level| self.coarse.levels[level].partition.tiles.len()).sum::<usize>()
    }

    /// The resource numbers of some aggregates of a level.
    fn of_level(&self, level: usize, aggregates: impl Iterator<Item = u32>) -> Vec<u32> {
        if level >= self.coarse.shared() {
            return vec![self.count() as u32 - 1];
        }
        let first = self.first_of_level(level) as u32;
        distinct(aggregates.map(|aggregate| first + tile_with(&self.coarse.levels[level].partition.tiles, aggregate)).collect())
    }

    /// The resources that each task of a pass accesses.
    fn touched(&self, pass: &Pass) -> Vec<Vec<u32>> {
        let Resources { partition, coarse, .. } = *self;
        let tiles = 0..partition.tiles.len() as u32;
        match self.domain(pass) {
            Domain::Everything => vec![(0..self.count() as u32).collect()],
            // Includes the level that the first of them is restricted from.
            Domain::SmallLevels(first) => {
                vec![(self.first_of_level(first.saturating_sub(1)) as u32..self.count() as u32).collect()]
            }
            Domain::Chunks => {
                let tile = |chunk: &Range<u32>| tile_with(&partition.tiles, chunk.start);
                let around = pass[0].reads_neighbors();
                let touched = |tile: u32| if around { partition.around[tile as usize].clone() } else { vec![tile] };
                self.chunks.into_iter().flatten().map(|chunk| touched(tile(chunk))).collect()
            }
            Domain::Tiles if pass[0].reads_neighbors() => partition.around.clone(),
            Domain::Tiles => tiles.map(|tile| vec![tile]).collect(),
            Domain::Triangles => self.panel_tiles.to_vec(),
            Domain::Borders(round) => partition.rounds[round].iter().map(|piece| piece.touches.clone()).collect(),
            Domain::Aggregates(level) => {
                let resources = |chunk: Range<usize>| self.of_level(level, chunk.map(|aggregate| aggregate as u32));
                coarse.restrictions(level).map(resources).collect()
            }
            // A piece of the first round also receives the coarser correction for its whole tile, whichever edges it
            // has.
            Domain::PiecesOfLevel(level, 0) => {
                let first = self.first_of_level(level) as u32;
                (0..coarse.levels[level].partition.tiles.len() as u32).map(|tile| vec![first + tile]).collect()
            }
            Domain::PiecesOfLevel(level, round) => {
                let first = self.first_of_level(level) as u32;
                let pieces = coarse.levels[level].partition.rounds[round].iter();
                pieces.map(|piece| piece.touches.iter().map(|tile| first + tile).collect()).collect()
            }
        }
    }

    /// Additional resources that each task of a pass waits for without reserving them (see [`PassTasks::awaits`]).
    ///
    /// These are reads for which the opposite (write-after-read) dependency follows from others. Prolongation reads the
    /// corrections of a level's aggregates; the next task to write those is the restriction to the same aggregates,
    /// which waits for their members, and those were corrected by this very prolongation. Restriction reads the members
    /// of its aggregates; the next task to write those is the prolongation, which waits for the aggregates.
    fn awaited(&self, pass: &Pass) -> Vec<Vec<u32>> {
        let Resources { partition, coarse, .. } = *self;
        match self.domain(pass) {
            Domain::Tiles if pass.contains(&Stage::Correct) => {
                let labels = |tile: &Range<u32>| self.of_level(0, coarse.labels(0, tile.clone()));
                partition.tiles.iter().map(labels).collect()
            }
            Domain::Aggregates(level) => {
                // A task could begin as soon as the members of its aggregates are ready. It waits for all tiles
                // instead: the sweep of the smallest levels needs all aggregates anyway, and a worker without other
                // work would restrict vertices that are in another core's cache rather than help that worker with its
                // edges.
                let below = |chunk| match level {
                    0 => (0..partition.tiles.len() as u32).collect(),
                    _ => self.of_level(level - 1, coarse.members(level, chunk)),
                };
                coarse.restrictions(level).map(below).collect()
            }
            // In the first round the piece of a tile receives the correction of the next coarser level for that whole
            // tile.
            Domain::PiecesOfLevel(level, 0) if level + 1 < coarse.levels.len() => {
                let labels = |tile: &Range<u32>| self.of_level(level + 1, coarse.labels(level + 1, tile.clone()));
                coarse.levels[level].partition.tiles.iter().map(labels).collect()
            }
            _ => Vec::new(),
        }
    }
}
