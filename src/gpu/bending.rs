//! Bending on the GPU. All passes run in one dispatch over tiles, or, where tiles would hold too much, in a dispatch
//! for each exchange between neighbors.

use crate::device::{Entry, Gpu};
use crate::gpu::bend_tiles::{BendTiles, push_rings};
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, BindGroup, ComputePass, SLOT, Sent, Stage, fill_slots, lanes, slot};
use crate::gpu::state::{StateBuffers, bound_by_predict, stage};
use crate::gpu::tiles::TileSize;
use crate::kernels::bending::BendPass;
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::Level;
use crate::step::bending::MAX_PASSES;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// Number of vertices up to which recomputing rings of neighbors is faster than waiting for more dispatches.
const LARGE: usize = 1 << 16;
/// Number of tiles that keep a large GPU busy, and the range of a tile's own vertices.
const TILES: usize = 256;
const OWN: [usize; 2] = [32, 128];
/// Bytes of workgroup memory per vertex with moments, with one pass and with several, and per vertex.
const IN_TILE: [usize; 2] = [24, 72];
const HELD: usize = 24;
/// Buffer space for the moments of a vertex, as a multiple of that for its displacement, with one pass and with several.
pub(super) const MOMENTS: [u64; 2] = [2, 6];
/// The room of tiles is a multiple of this number of vertices.
const ROOMS: usize = 32;

/// Resources of the kernels: the states, the displacements, the uniforms and the pins, and the level that they average with
/// the buffer of its averages, if that is wanted.
#[derive(Clone, Copy)]
pub(super) struct BendingInputs<'a> {
    pub states: &'a [StateBuffers],
    pub u: &'a wgpu::Buffer,
    pub uniforms: &'a BindGroup,
    pub pins: &'a Sent,
    pub level: Option<(&'a Level, &'a wgpu::Buffer)>,
}

/// The kernels of bending and their buffers.
pub(super) struct Bending {
    rows: wgpu::Buffer,
    /// The slices of the rings of all vertices, once kernels without tiles need them.
    slices: Option<wgpu::Buffer>,
    passes: wgpu::Buffer,
    /// The substep that the rows were computed for, and whether a level is averaged.
    prepared: Option<(Length, bool)>,
    /// Kernels for each number of passes used so far, without and with averages; `None` where tiles would be too large. `in_use` is the
    /// index of the last ones. A change of the substep changes the number.
    kernels: Vec<((usize, bool), Option<InTiles>)>,
    in_use: usize,
    /// The kernels without tiles, once they are needed.
    apart: Option<Apart>,
}

/// One kernel with so many tiles.
struct InTiles {
    stage: Stage,
    tiles: usize,
}

/// `moments` computes the first moments along with the prediction. In each further pass, `again` displaces the
/// vertices tentatively, then recomputes the moments. `forces` turns these into forces.
struct Apart {
    /// Whether there is room for the moments of `several` passes.
    several: bool,
    moments: Stage,
    again: [Stage; 2],
    forces: Stage,
}

impl Bending {
    pub(super) fn new(gpu: &Gpu, plan: &Plan<'_>) -> Bending {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let rows = gpu.filled("bend rows", &plan.coefficients.bending.rows);
        let passes = gpu.make("bend passes", (MAX_PASSES * SLOT) as u64, usage);
        Bending { rows, slices: None, passes, prepared: None, kernels: Vec::new(), in_use: 0, apart: None }
    }

    /// Prepares for a plan; with tiles if `tiled` and the cloth is small enough for them to be faster.
    pub(super) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>, bound: BendingInputs<'_>, tiled: bool) {
        let wanted = Some((plan.coefficients.length, bound.level.is_some()));
        if std::mem::replace(&mut self.prepared, wanted) == wanted {
            return;
        }
        let count = plan.coefficients.bending.passes_or_one().len();
        let key = (count, bound.level.is_some());
        let made = self.kernels.iter().position(|(of, _)| *of == key);
        self.in_use = made.unwrap_or(self.kernels.len());
        if made.is_none() {
            self.kernels.push((key, self.make_tiles(gpu, plan, bound, count, tiled)));
        }
        if !self.in_tiles() && self.apart.as_ref().is_none_or(|apart| count > 1 && !apart.several) {
            self.apart = None;
            self.apart = Some(self.make_apart(gpu, plan.cloth, bound, count > 1));
        }
        self.send(gpu, plan);
    }

    fn send(&self, gpu: &Gpu, plan: &Plan<'_>) {
        let bending = &plan.coefficients.bending;
        gpu.write(&self.rows, 0, &bending.rows);
        if self.in_tiles() {
            return gpu.write(&self.passes, 0, bending.passes_or_one());
        }
        let mut slots = Vec::new();
        fill_slots(&mut slots, bending.passes_or_one());
        gpu.write(&self.passes, 0, &slots);
    }

    /// Whether the kernels use tiles.
    pub(super) fn in_tiles(&self) -> bool {
        self.kernels[self.in_use].1.is_some()
    }

    /// Whether the kernels average the displacements for a level.
    pub(super) fn averages(&self) -> bool {
        matches!(self.kernels[self.in_use], ((_, true), Some(_)))
    }

    /// Encodes the prediction from state `from`, and the bending forces.
    pub(super) fn encode(&self, pass: &mut ComputePass, plan: &Plan<'_>, from: usize) {
        let vertices = plan.cloth.rest.len();
        let ((count, _), in_tiles) = &self.kernels[self.in_use];
        if let Some(InTiles { stage, tiles }) = in_tiles {
            stage.dispatch_workgroups(pass, from, &[], *tiles);
        } else if let Some(Apart { moments, again, forces, .. }) = &self.apart {
            moments.dispatch(pass, from, &slot(0), vertices + plan.pins.len());
            for number in 1..*count {
                again.iter().for_each(|stage| stage.dispatch(pass, from, &slot(number), vertices));
            }
            forces.dispatch(pass, from, &slot(0), vertices);
        }
    }

    /// Creates a kernel for `count` passes in tiles if that is wanted, and the cloth is small enough.
    fn make_tiles(&self, gpu: &Gpu, plan: &Plan<'_>, bound: BendingInputs<'_>, count: usize, tiled: bool) -> Option<InTiles> {
        let (vertices, entries) = (plan.cloth.rest.len(), &plan.cloth.bending().entries);
        let in_vertex = IN_TILE[usize::from(count > 1)];
        let room = gpu.workgroup_memory() / (in_vertex + HELD);
        let most =
            TileSize { own: vertices.div_ceil(TILES).clamp(OWN[0], OWN[1]).min(room), room, bytes: gpu.most_table_bytes() };
        let level = bound.level.map(|(level, _)| level);
        let tiles = (tiled && vertices <= LARGE).then(|| BendTiles::new(&plan.cloth.rest, entries, 2 * count - 1, most, level));
        tiles.flatten().map(|tiles| self.kernel(gpu, bound, &tiles, room, count > 1))
    }

    /// The room of a tile is rounded up, so that tiles of similar size share a kernel and changes of the substep rarely
    /// compile one. It is not all of the memory, because a multiprocessor could then hold only one tile at a time.
    fn kernel(&self, gpu: &Gpu, bound: BendingInputs<'_>, tiles: &BendTiles, most: usize, filtered: bool) -> InTiles {
        let room = tiles.largest.next_multiple_of(ROOMS).min(most);
        let table = gpu.filled("bend tiles", &tiles.table);
        let longest = tiles.longest.next_multiple_of(ROOMS).min(most);
        let constants = [
            ("LANES", lanes(gpu, room)),
            ("BENT", room),
            ("MOMENTS", IN_TILE[usize::from(filtered)] / size_of::<[f32; 3]>() * room),
            ("HELD", longest),
            ("FILTERED", usize::from(filtered)),
        ];
        let constants = constants.map(|(name, value)| (name, value as f64));
        let groups: Vec<_> = bound
            .states
            .iter()
            .map(|state| {
                let mut all = bound_by_predict(state, bound.u, bound.pins);
                all.extend([Bind::Read(&self.rows), Bind::Read(&table), Bind::Uniform(&self.passes)]);
                all.extend(bound.level.map(|(_, averages)| Bind::Write(averages)));
                all
            })
            .collect();
        let name = if bound.level.is_some() { "bend_and_average_tile" } else { "bend_tile" };
        let entry = Entry { shader: shaders::BEND_TILE, name, constants: &constants };
        InTiles { stage: Stage::new(gpu, bound.uniforms, entry, &groups), tiles: tiles.count }
    }

    fn make_apart(&mut self, gpu: &Gpu, cloth: &Cloth, bound: BendingInputs<'_>, several: bool) -> Apart {
        let BendingInputs { states, u, uniforms, pins, .. } = bound;
        let slices = self.slices.get_or_insert_with(|| {
            let mut table = Vec::new();
            push_rings(&mut table, cloth.rest.len(), |v| cloth.bending().entries.of(v as u32), |vertex| vertex);
            gpu.filled("bend slices", &table)
        });
        let moments = gpu.buffer("moments", MOMENTS[usize::from(several)] * u.size());
        let passes = Bind::Dynamic(&self.passes, size_of::<BendPass>());
        let stage = |name| {
            stage(gpu, uniforms, shaders::BEND, name, states, |state| {
                let lists = [Bind::Read(&self.rows), Bind::Read(slices), Bind::Write(&moments), passes];
                [bound_by_predict(state, u, pins), lists.to_vec()].concat()
            })
        };
        let again = ["displace_tentatively", "pass_moments"].map(stage);
        Apart { several, moments: stage("bend_moments"), again, forces: stage("bend_forces") }
    }
}
