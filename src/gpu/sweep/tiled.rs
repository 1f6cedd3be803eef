//! One dispatch per substep: each workgroup processes a tile of the cloth and its halo, with bending in a single pass or with
//! the correction by a single level if the substep has that.

use std::sync::OnceLock;

use crate::device::{Entry, Gpu};
use crate::gpu::forces::Forces;
use crate::gpu::multigrid::Multigrid;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, ComputePass, NONE, Sent, Stage, lanes};
use crate::gpu::state::{PING_PONG, StateBuffers, groups};
use crate::gpu::sweep::rings::{Rings, with_rings};
use crate::gpu::tethers;
use crate::gpu::tiles::{IN_LEVEL_TILE, Tiles};
use crate::kernels::integrate::Pin;
use crate::model::cloth::Cloth;
use crate::model::csr::distinct;
use crate::multigrid::hierarchy::Level;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// Sweeps of a substep in tiles.
pub(crate) struct Tiled {
    pub tiles: Tiles,
    /// The tiles, followed by what the places below say.
    table: wgpu::Buffer,
    at: Places,
    /// The substep that the table's edges are computed for.
    length: Option<Length>,
    /// The tiles of the level that it corrects by, if it does.
    pub level: Option<Tiles>,
    /// The groups of [`PING_PONG`] that predict, followed by those that read what the forces predicted.
    stage: Stage,
}

/// Tiles that do more than sweep: made when a step first needs them; `None` if there is no room for them.
pub(crate) type OnDemand = OnceLock<Option<Box<Tiled>>>;

/// The buffers that tiles work on besides their table.
#[derive(Clone, Copy)]
pub(crate) struct SweepInputs<'a> {
    pub forces: &'a Forces,
    pub bodies: &'a Sent,
    pub found: &'a wgpu::Buffer,
    pub multigrid: Option<&'a Multigrid>,
}

/// The bytes of the table at which the tethers begin, the pins, the rows of bending, the rings and the level; then its end.
struct Places {
    tethers: usize,
    pins: usize,
    rows: usize,
    rings: usize,
    level: usize,
    end: usize,
}

impl Places {
    fn new(cloth: &Cloth, tiles: &Tiles, rings: Option<&Rings>, level: Option<&Tiles>) -> Places {
        let vertices = cloth.rest.len();
        let tethers = size_of_val(tiles.table.as_slice());
        let pins = tethers + tethers::size(cloth);
        let pinned = cloth.pinned.len();
        let rows = pins + if pinned > 0 { size_of::<u32>() * vertices + size_of::<Pin>() * pinned } else { 0 };
        let rings_at = rows + rings.map_or(0, |_| size_of::<[f32; 3]>() * vertices);
        let level_at = rings_at + rings.map_or(0, |of| size_of_val(of.table.as_slice()));
        let end = level_at + level.map_or(0, |of| size_of_val(of.table.as_slice()));
        Places { tethers, pins, rows, rings: rings_at, level: level_at, end }
    }
}

impl Tiled {
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, tiles: Tiles, bound: SweepInputs<'_>) -> Tiled {
        let invocations = lanes(gpu, tiles.widest);
        Tiled::with(gpu, cloth, tiles, invocations, None, None, bound)
    }

    /// The same tiles with bending, for substeps that have that in a single pass and no levels. `None` if there is no
    /// room for the rings around the tiles.
    pub(crate) fn bent(&self, gpu: &Gpu, cloth: &Cloth, bound: SweepInputs<'_>) -> Option<Tiled> {
        let (tiles, rings) = with_rings(gpu, &self.tiles, &cloth.bending().entries)?;
        let invocations = lanes(gpu, tiles.largest);
        Some(Tiled::with(gpu, cloth, tiles, invocations, Some(&rings), None, bound))
    }

    /// The same tiles with the correction by the finest level, for substeps that have no other. `None` if there is no room for
    /// the aggregates around the tiles.
    pub(crate) fn corrected(&self, gpu: &Gpu, cloth: &Cloth, level: &Level, bound: SweepInputs<'_>) -> Option<Tiled> {
        let (tiles, of_level) = with_level(gpu, &self.tiles, level)?;
        let invocations = lanes(gpu, self.tiles.largest);
        Some(Tiled::with(gpu, cloth, tiles, invocations, None, Some(of_level), bound))
    }

    /// With so many `invocations` per workgroup.
    fn with(
        gpu: &Gpu,
        cloth: &Cloth,
        tiles: Tiles,
        invocations: usize,
        rings: Option<&Rings>,
        level: Option<Tiles>,
        bound: SweepInputs<'_>,
    ) -> Tiled {
        let at = Places::new(cloth, &tiles, rings, level.as_ref());
        let table = gpu.buffer("tiles", at.end as u64);
        gpu.write(&table, 0, &tiles.table);
        if !cloth.pinned.is_empty() {
            gpu.write(&table, at.pins, &index_of_pins(cloth));
        }
        let word = |byte: usize| (byte / size_of::<u32>()) as f64;
        let mut constants = tiles.constants(invocations).to_vec();
        constants.extend([("TETHERS", word(at.tethers)), ("PINS", word(at.pins))]);
        let mut entry = shaders::PLAIN_TILE.entry("substep_of_tile");
        if let Some(Rings { table: entries, swept, bent, ring }) = rings {
            gpu.write(&table, at.rings, entries);
            entry = shaders::BENT_TILE.entry("substep_of_bent_tile");
            constants.extend([("ROWS", word(at.rows)), ("RINGS", word(at.rings))]);
            let numbers = [("FORCED", *swept), ("BENT", *bent), ("RING", *ring), ("MOMENTS", 2 * bent)];
            constants.extend(numbers.map(|(name, value)| (name, value as f64)));
        }
        if let Some(of_level) = &level {
            gpu.write(&table, at.level, &of_level.table);
            entry = shaders::CORRECTED_TILE.entry("substep_of_corrected_tile");
            let numbers = [("LEVEL_ROOM", of_level.largest), ("LEVEL_WIDTH", of_level.widest), ("LEVEL_COLORS", of_level.colors)];
            constants.push(("LEVEL_TABLE", word(at.level)));
            constants.extend(numbers.map(|(name, value)| (name, value as f64)));
        }
        let entry = Entry { constants: &constants, ..entry };
        let stage = Stage::new(gpu, &bound.forces.uniforms, entry, &Tiled::groups(&table, level.is_some(), bound));
        Tiled { tiles, table, at, length: None, level, stage }
    }

    /// Whether it bends the cloth: its table has the rows of bending.
    fn bends(&self) -> bool {
        self.at.rows < self.at.rings
    }

    fn groups<'a>(table: &'a wgpu::Buffer, corrects: bool, bound: SweepInputs<'a>) -> Vec<Vec<Bind<'a>>> {
        let SweepInputs { forces, bodies, found, multigrid } = bound;
        // Without levels another buffer is bound, which is not read.
        let of_levels = multigrid.map_or(&forces.u, |levels| if corrects { &levels.averages } else { &levels.shift });
        let bound = |from: &'a StateBuffers, to: &'a StateBuffers, motion: &'a wgpu::Buffer| {
            vec![
                Bind::Read(table),
                Bind::Read(&from.x),
                Bind::Read(motion),
                Bind::Read(&bodies.buffer),
                Bind::Write(&to.x),
                Bind::Write(&to.p),
                Bind::Read(of_levels),
                Bind::Write(found),
            ]
        };
        let mut bound_by_all = groups(&forces.states, |from, to| bound(from, to, &from.p));
        bound_by_all.extend(groups(&forces.states, |from, to| bound(from, to, &forces.u)));
        bound_by_all
    }

    pub(crate) fn rebind(&mut self, gpu: &Gpu, bound: SweepInputs<'_>) {
        self.stage.rebind(gpu, &Tiled::groups(&self.table, self.level.is_some(), bound));
    }

    /// Stores the aggregate of each vertex.
    pub(crate) fn set_labels(&mut self, gpu: &Gpu, labels: &[u32]) {
        self.tiles.set_labels(|vertex| labels[vertex as usize], 0);
        gpu.write(&self.table, 0, &self.tiles.table);
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        if !plan.pins.is_empty() {
            gpu.write(&self.table, self.at.pins + size_of::<u32>() * plan.cloth.rest.len(), plan.pins);
        }
        if self.length != Some(plan.coefficients.length) && plan.params.sweeps > 0 {
            self.tiles.send_edges(gpu, &self.table, 0, &plan.coefficients.edges);
            if let (Some(of_level), [edges, ..]) = (&mut self.level, plan.coefficients.levels.as_slice()) {
                of_level.send_edges(gpu, &self.table, self.at.level, edges);
            }
            tethers::send(gpu, plan, &self.table, self.at.tethers);
            if self.bends() {
                gpu.write(&self.table, self.at.rows, &plan.coefficients.bending.rows);
            }
            self.length = Some(plan.coefficients.length);
        }
    }

    /// Encodes a substep, number `group` of [`PING_PONG`]. With bending, tiles always predict; otherwise unless the
    /// displacements are `predicted` already.
    pub(crate) fn encode(&self, pass: &mut ComputePass, group: usize, predicted: bool) {
        let predicted = usize::from(predicted && !self.bends()) * PING_PONG.len();
        self.stage.dispatch_workgroups(pass, group + predicted, &[], self.tiles.count);
    }
}

/// For each vertex its index among the pins, which are sorted by vertex; [`NONE`] for all others.
fn index_of_pins(cloth: &Cloth) -> Vec<u32> {
    let mut index = vec![NONE; cloth.rest.len()];
    distinct(cloth.pinned.clone()).iter().zip(0..).for_each(|(&vertex, k)| index[vertex as usize] = k);
    index
}

/// For each tile one of the level, whose own aggregates are those of the tile's vertices; and the tiles with their vertices'
/// aggregates by their places in it. `None` if some tile would have no room, or more vertices than a workgroup has
/// invocations.
fn with_level(gpu: &Gpu, tiles: &Tiles, level: &Level) -> Option<(Tiles, Tiles)> {
    let lists: Vec<&[u32]> = tiles.lists().collect();
    let aggregates = |list: &&[u32]| distinct(list.iter().map(|&vertex| level.label[vertex as usize]).collect());
    let own: Vec<Vec<u32>> = lists.iter().map(aggregates).collect();
    let room = gpu.workgroup_memory() / IN_LEVEL_TILE;
    let of_level = Tiles::around(&own, level.inverse_mass.len(), &level.links, &level.colors, room)?;
    let invocations = lanes(gpu, tiles.largest);
    let fits = tiles.largest <= invocations.min(room) && tiles.bytes() + of_level.bytes() <= gpu.most_table_bytes();
    fits.then(|| {
        // Vertices and aggregates are held in the same memory, one after the other.
        let room = tiles.largest.max(of_level.largest);
        let mut tiles = tiles.with_lists(&lists, room);
        tiles.set_places(&level.label, &of_level);
        (tiles, of_level)
    })
}
