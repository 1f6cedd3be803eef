//! One dispatch per substep: each workgroup processes a tile of the cloth and its halo.

use crate::device::{Entry, Gpu};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, Sent, Stage};
use crate::gpu::state::{PING_PONG, State, groups};
use crate::gpu::tethers;
use crate::gpu::tiles::Tiles;
use crate::model::cloth::Cloth;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// Sweeps of a substep in tiles.
#[derive(Debug)]
pub(crate) struct Tiled {
    pub tiles: Tiles,
    /// The tiles, followed by the tethers if there are any.
    table: wgpu::Buffer,
    /// The substep that the table's edges are computed for.
    length: Option<Length>,
    /// The groups of [`PING_PONG`] that predict, followed by those that read what the forces predicted.
    stage: Stage,
}

impl Tiled {
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, tiles: Tiles, forces: &Forces, bodies: &Sent, found: &wgpu::Buffer) -> Tiled {
        let bytes = size_of_val(tiles.table.as_slice());
        let table = gpu.buffer("tiles", (bytes + tethers::size(cloth)) as u64);
        gpu.write(&table, 0, &tiles.table);
        let constants = [&tiles.constants(gpu)[..], &[("TETHERS", tiles.table.len() as f64)]].concat();
        let entry = Entry { shader: shaders::TILE, name: "substep_of_tile", constants: &constants };
        let stage = Stage::new(gpu, &forces.uniforms, entry, &Tiled::bound(&table, forces, bodies, found, None));
        Tiled { tiles, table, length: None, stage }
    }

    fn bound<'a>(
        table: &'a wgpu::Buffer,
        forces: &'a Forces,
        bodies: &'a Sent,
        found: &'a wgpu::Buffer,
        shift: Option<&'a wgpu::Buffer>,
    ) -> Vec<Vec<Bind<'a>>> {
        // Without levels another buffer is bound, which is not read.
        let shift = shift.unwrap_or(&forces.u);
        let bound = |from: &'a State, to: &'a State, motion: &'a wgpu::Buffer| {
            vec![
                Bind::Read(table),
                Bind::Read(&from.x),
                Bind::Read(motion),
                Bind::Read(&bodies.buffer),
                Bind::Write(&to.x),
                Bind::Write(&to.p),
                Bind::Read(shift),
                Bind::Write(found),
            ]
        };
        let mut bound_by_all = groups(&forces.states, |from, to| bound(from, to, &from.p));
        bound_by_all.extend(groups(&forces.states, |from, to| bound(from, to, &forces.u)));
        bound_by_all
    }

    pub(crate) fn rebind(
        &mut self,
        gpu: &Gpu,
        forces: &Forces,
        bodies: &Sent,
        found: &wgpu::Buffer,
        shift: Option<&wgpu::Buffer>,
    ) {
        self.stage.rebind(gpu, &Tiled::bound(&self.table, forces, bodies, found, shift));
    }

    /// Stores the aggregate of each vertex.
    pub(crate) fn set_labels(&mut self, gpu: &Gpu, labels: &[u32]) {
        self.tiles.set_labels(|vertex| labels[vertex as usize], 0);
        gpu.write(&self.table, 0, &self.tiles.table);
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        if self.length != Some(plan.coefficients.length) && plan.sweeps > 0 {
            self.tiles.send_edges(gpu, &self.table, &plan.coefficients.edges);
            tethers::send(gpu, plan, &self.table, size_of_val(self.tiles.table.as_slice()));
            self.length = Some(plan.coefficients.length);
        }
    }

    /// Encodes a substep, number `group` of [`PING_PONG`].
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, group: usize) {
        let predicted = plan.params.predicted as usize * PING_PONG.len();
        self.stage.dispatch_workgroups(pass, group + predicted, &[], self.tiles.count);
    }
}
