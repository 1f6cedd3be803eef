//! A whole step in one dispatch: one workgroup holds the cloth as a single tile.

use glam::Vec4;

use crate::device::{Entry, Gpu};
use crate::gpu::multigrid::LevelTable;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, ComputePass, Stage, lanes};
use crate::gpu::sweep::forces_in_workgroup::ForceTable;
use crate::gpu::sweep::tiled::SweepInputs;
use crate::gpu::tethers;
use crate::gpu::tiles::{TileSize, Tiles};
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::Level;
use crate::options::Method;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// Bytes of workgroup memory per vertex, and per aggregate.
const OF_VERTEX: usize = 12;
const OF_AGGREGATE: usize = 48;

/// A step in one workgroup.
pub(crate) struct SingleWorkgroup {
    pub tiles: Tiles,
    /// All levels, if levels are used.
    levels: Option<LevelTable>,
    forces: ForceTable,
    /// Contains the tile, the levels, the inverse masses of their aggregates, the tethers (from byte `tethers` on), and
    /// the forces.
    table: wgpu::Buffer,
    tethers: usize,
    state: wgpu::Buffer,
    /// The substep and the number of levels that the table's edges were computed for.
    sent: Option<(Length, usize)>,
    stage: Stage,
}

impl SingleWorkgroup {
    /// Includes bending and wind if `wanted`. Returns `None` if the cloth or its levels do not fit into the memory of a
    /// workgroup.
    pub(crate) fn new(
        gpu: &Gpu,
        cloth: &Cloth,
        levels: &[Level],
        wanted: [bool; 2],
        inputs: SweepInputs<'_>,
    ) -> Option<SingleWorkgroup> {
        let room = gpu.workgroup_memory() / OF_VERTEX;
        let aggregates: usize = levels.iter().map(|level| level.inverse_mass.len()).sum();
        if cloth.rest.len() > room || OF_AGGREGATE * aggregates > gpu.workgroup_memory() {
            return None;
        }
        let size = TileSize { own: room, room, bytes: gpu.most_table_bytes() };
        let tiles = Tiles::new(&cloth.rest, cloth.swept(), &cloth.visits(), size);
        let mut tiles = tiles.filter(|tiles| tiles.count == 1)?;
        if let Some(finest) = levels.first() {
            tiles.set_labels(|vertex| finest.label[vertex as usize], 0);
        }
        let level_table = (!levels.is_empty()).then(|| LevelTable::new(levels, 0, Some(0)));
        let mut table = tiles.table.clone();
        level_table.iter().for_each(|levels| table.extend(&levels.table));
        table.extend(levels.iter().flat_map(|level| &level.inverse_mass).map(|w| w.to_bits()));
        let tethers = size_of_val(table.as_slice());
        table.resize(table.len() + tethers::size(cloth) / size_of::<u32>(), 0);
        let force_table = ForceTable::push(&mut table, cloth, wanted);
        let table = gpu.filled("single workgroup", &table);
        let vectors = 2 * cloth.rest.len() + force_table.vectors(cloth.rest.len());
        let state = gpu.buffer("state in work", (vectors * size_of::<Vec4>()) as u64);

        let coarse = LevelTable::constants(level_table.as_ref(), tiles.table.len());
        let vectors = [("VECTORS", tiles.largest.max(4 * aggregates) as f64), ("AHEAD", 0.0)];
        let at = [("TETHERS", (tethers / size_of::<u32>()) as f64)];
        let constants =
            [&tiles.constants(lanes(gpu, tiles.widest))[..], &coarse, &vectors, &at, &force_table.constants()].concat();
        let entry = Entry { shader: shaders::SINGLE_WORKGROUP, name: "step_in_workgroup", constants: &constants };
        let stage = Stage::new(gpu, &inputs.forces.uniforms, entry, &[SingleWorkgroup::bound(&table, &state, inputs)]);
        Some(SingleWorkgroup { tiles, levels: level_table, forces: force_table, table, tethers, state, sent: None, stage })
    }

    fn bound<'a>(table: &'a wgpu::Buffer, state: &'a wgpu::Buffer, inputs: SweepInputs<'a>) -> Vec<Bind<'a>> {
        let SweepInputs { forces, bodies, found, .. } = inputs;
        vec![
            Bind::Read(table),
            Bind::Read(&forces.all_substeps.buffer),
            Bind::Read(&forces.pins.buffer),
            Bind::Read(&bodies.buffer),
            Bind::Write(&forces.states[0].x),
            Bind::Write(&forces.states[0].p),
            Bind::Write(state),
            Bind::Write(found),
        ]
    }

    pub(crate) fn rebind(&mut self, gpu: &Gpu, inputs: SweepInputs<'_>) {
        let bound = SingleWorkgroup::bound(&self.table, &self.state, inputs);
        self.stage.rebind(gpu, &[bound]);
    }

    /// Whether it includes levels.
    pub(crate) fn has_levels(&self) -> bool {
        self.levels.is_some()
    }

    /// Whether it includes bending, and wind.
    pub(crate) fn forces(&self) -> [bool; 2] {
        [self.forces.bends, self.forces.air]
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        let SingleWorkgroup { tiles, levels, forces, table, tethers, sent, .. } = self;
        let asked = Some((plan.coefficients.length, plan.coefficients.levels.len()));
        if std::mem::replace(sent, asked) == asked {
            return;
        }
        tiles.send_edges(gpu, table, 0, &plan.coefficients.edges);
        tethers::send(gpu, plan, table, *tethers);
        forces.send(gpu, plan, table);
        if let Some(levels) = levels {
            levels.send_edges(gpu, table, size_of_val(tiles.table.as_slice()), &plan.coefficients.levels);
        }
    }

    /// Whether it includes everything that a step uses.
    pub(crate) fn does(&self, plan: &Plan<'_>) -> bool {
        let has_levels = plan.params.levels == 0 || self.has_levels();
        let [bends, air] = self.forces();
        has_levels && (bends || !plan.bending) && (air || !plan.air) && plan.method != Method::Springs
    }

    /// Encodes the dispatch of a step.
    pub(crate) fn encode(&self, pass: &mut ComputePass) {
        self.stage.dispatch_workgroups(pass, 0, &[], 1);
    }
}
