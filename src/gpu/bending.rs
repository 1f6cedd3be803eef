//! Bending on the GPU: all of its passes in one dispatch over tiles, or where those would hold too much, a dispatch for each time that
//! neighbors look at one another.

use crate::device::{Entry, Gpu};
use crate::gpu::bend_tiles::BendTiles;
use crate::gpu::forces::{bound_by_predict, stage};
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, Group, SLOT, Sent, Stage, fill_slots, lanes, slot};
use crate::gpu::state::State;
use crate::gpu::tiles::TileSize;
use crate::kernels::bending::BendPass;
use crate::step::bending::{BendRows, MOST_PASSES};
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// Vertices up to which waiting for dispatches takes longer than computing rings again.
const LARGE: usize = 1 << 16;
/// Tiles that keep a large GPU busy, and the vertices of its own that one has at least and at most.
const TILES: usize = 256;
const OWN: [usize; 2] = [32, 128];
/// Bytes of workgroup memory that a vertex takes with one pass, and with several.
const IN_TILE: [usize; 2] = [24, 72];
/// Vertices by which tiles have room for more.
const ROOMS: usize = 32;
/// A single pass, which filters nothing.
const ONCE: [BendPass; 1] = [BendPass { carry: 0.0, gain: 0.0, way: 0.0, last: 1 }];

/// The kernels of bending, and what they read.
#[derive(Debug)]
pub(super) struct Bending {
    lists: Lists,
    /// The substep that the rows are for.
    length: Option<Length>,
    /// For each number of passes that a step has asked for, and which the last one did: substeps that change ask for others.
    kernels: Vec<(usize, Kernels)>,
    in_use: usize,
}

#[derive(Debug)]
enum Kernels {
    /// In so many tiles.
    Tiles(Stage, usize),
    /// The first moments with the prediction; vertices give way, and moments again; the forces.
    Apart { moments: Stage, again: [Stage; 2], forces: Stage },
}

impl Bending {
    pub(super) fn new(gpu: &Gpu, plan: &Plan<'_>) -> Bending {
        let entries = &plan.cloth.bending().entries;
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let lists = Lists {
            rows: gpu.filled("bend rows", &plan.coefficients.bending.rows),
            spans: gpu.filled("bend spans", &entries.spans),
            entries: gpu.filled("bend entries", &entries.items),
            passes: gpu.make("bend passes", (MOST_PASSES * SLOT) as u64, usage),
        };
        Bending { lists, length: None, kernels: Vec::new(), in_use: 0 }
    }

    /// Makes ready for a plan; in tiles if that pays and is wanted.
    pub(super) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>, bound: Bound<'_>, tiled: bool) {
        if self.length == Some(plan.coefficients.length) {
            return;
        }
        self.length = Some(plan.coefficients.length);
        let count = plan.coefficients.bending.passes.len().max(1);
        self.in_use = self.kernels.iter().position(|(passes, _)| *passes == count).unwrap_or_else(|| {
            self.kernels.push((count, self.lists.kernels(gpu, plan, bound, count, tiled)));
            self.kernels.len() - 1
        });
        self.send(gpu, plan);
    }

    fn send(&self, gpu: &Gpu, plan: &Plan<'_>) {
        let BendRows { rows, passes, .. } = &plan.coefficients.bending;
        gpu.write(&self.lists.rows, 0, rows);
        if self.in_tiles() {
            return gpu.write(&self.lists.passes, 0, if passes.is_empty() { &ONCE } else { passes });
        }
        let mut slots = Vec::new();
        fill_slots(&mut slots, if passes.is_empty() { &ONCE } else { passes });
        gpu.write(&self.lists.passes, 0, &slots);
    }

    /// Whether it is done in tiles.
    pub(super) fn in_tiles(&self) -> bool {
        matches!(self.kernels[self.in_use].1, Kernels::Tiles(..))
    }

    /// Dispatches of a substep, that of the prediction among them.
    pub(super) fn dispatches(&self) -> usize {
        match self.kernels[self.in_use] {
            (_, Kernels::Tiles(..)) => 1,
            (count, Kernels::Apart { .. }) => 2 * count,
        }
    }

    /// Encodes the prediction of a substep that starts from state number `from`, and the forces on it.
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, from: usize) {
        let vertices = plan.cloth.rest.len();
        match &self.kernels[self.in_use] {
            (_, Kernels::Tiles(stage, tiles)) => stage.dispatch_workgroups(pass, from, &[], *tiles),
            (count, Kernels::Apart { moments, again, forces }) => {
                moments.dispatch(pass, from, &slot(0), vertices + plan.pins.len());
                for number in 1..*count {
                    again.iter().for_each(|stage| stage.dispatch(pass, from, &slot(number), vertices));
                }
                forces.dispatch(pass, from, &[], vertices);
            }
        }
    }
}

/// What the forces bind: the states, the displacements in the making, the uniforms and the pins.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bound<'a> {
    pub states: &'a [State],
    pub u: &'a wgpu::Buffer,
    pub uniforms: &'a Group,
    pub pins: &'a Sent,
}

/// The buffers of the rows.
#[derive(Debug)]
struct Lists {
    rows: wgpu::Buffer,
    spans: wgpu::Buffer,
    entries: wgpu::Buffer,
    passes: wgpu::Buffer,
}

impl Lists {
    /// For so many passes.
    fn kernels(&self, gpu: &Gpu, plan: &Plan<'_>, bound: Bound<'_>, count: usize, tiled: bool) -> Kernels {
        let (vertices, entries) = (plan.cloth.rest.len(), &plan.cloth.bending().entries);
        let in_vertex = IN_TILE[usize::from(count > 1)];
        let room = gpu.workgroup_memory() / in_vertex;
        let most = TileSize { own: (vertices / TILES).clamp(OWN[0], OWN[1]).min(room), room, bytes: gpu.most_table_bytes() };
        let tiles = (tiled && vertices <= LARGE).then(|| BendTiles::new(&plan.cloth.rest, entries, 2 * count - 1, most));
        match tiles.flatten() {
            Some(tiles) => self.in_tiles(gpu, bound, &tiles, room, count > 1),
            None => self.apart(gpu, bound, count),
        }
    }

    fn bound(&self) -> [Bind<'_>; 3] {
        [&self.rows, &self.spans, &self.entries].map(Bind::Read)
    }

    /// Tiles about as large share a kernel, so that substeps that change hardly ever compile one. All the room that there is would take all of the
    /// memory of a multiprocessor, on which then one tile waits for another.
    fn in_tiles(&self, gpu: &Gpu, bound: Bound<'_>, tiles: &BendTiles, room: usize, filtered: bool) -> Kernels {
        let room = tiles.largest.next_multiple_of(ROOMS).min(room);
        let table = gpu.filled("bend tiles", &tiles.table);
        let numbers = IN_TILE[usize::from(filtered)] / size_of::<f32>() * room;
        let constants = [("LANES", lanes(gpu, room)), ("ROOM", room), ("NUMBERS", numbers), ("FILTERED", usize::from(filtered))];
        let constants = constants.map(|(name, value)| (name, value as f64));
        let groups: Vec<_> = bound
            .states
            .iter()
            .map(|state| {
                let last = [Bind::Read(&self.rows), Bind::Read(&table), Bind::Uniform(&self.passes)];
                [&bound_by_predict(state, bound.u, bound.pins)[..], &last].concat()
            })
            .collect();
        let entry = Entry { shader: shaders::BEND_TILE, name: "bend_tile", constants: &constants };
        Kernels::Tiles(Stage::new(gpu, bound.uniforms, entry, &groups), tiles.count)
    }

    fn apart(&self, gpu: &Gpu, Bound { states, u, uniforms, pins }: Bound<'_>, count: usize) -> Kernels {
        let moments = gpu.buffer("moments", if count > 1 { 6 } else { 2 } * u.size());
        let lists = [&self.bound()[..], &[Bind::Write(&moments)]].concat();
        let bend_pass = [Bind::Dynamic(&self.passes, size_of::<BendPass>())];
        let first = stage(gpu, uniforms, shaders::BEND, "bend_moments", states, |state| {
            [&bound_by_predict(state, u, pins)[..], &lists, &bend_pass].concat()
        });
        let again = ["give_way", "bend_again"].map(|name| {
            stage(gpu, uniforms, shaders::BEND, name, states, |state| {
                let x = if name == "give_way" { Bind::Read(&state.x) } else { Bind::Unused };
                [&[x, Bind::Unused, Bind::Unused, Bind::Unused], &lists[..], &bend_pass].concat()
            })
        });
        let forces = stage(gpu, uniforms, shaders::BEND, "bend_forces", states, |state| {
            [&[Bind::Read(&state.x), Bind::Unused, Bind::Write(u), Bind::Unused], &lists[..]].concat()
        });
        Kernels::Apart { moments: first, again, forces }
    }
}
