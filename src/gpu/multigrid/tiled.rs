//! Sweeping levels in workgroup memory: fine levels in tiles with a dispatch each, and the other levels together in one
//! workgroup.

use glam::Vec4;

use crate::device::{Entry, Gpu};
use crate::gpu::multigrid::level_table::LevelTable;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, BindGroup, ComputePass, NONE, Stage, lanes};
use crate::gpu::tiles::{TileSize, Tiles};
use crate::kernels::distance::Edge;
use crate::multigrid::hierarchy::Level;

/// Most own aggregates of a tile.
const OWN: usize = 256;

/// Tables with their buffers and the stages that read them, the finest level first.
pub(crate) struct TiledLevels {
    pub in_tiles: Vec<(Tiles, wgpu::Buffer, Stage)>,
    in_workgroup: Option<(LevelTable, wgpu::Buffer, Stage)>,
}

impl TiledLevels {
    /// `rest` are the centers of each level, whose aggregates are numbered from `starts` on. `None` if a level cannot
    /// be divided into tiles, or would have to be swept several times in them.
    pub(crate) fn new(
        gpu: &Gpu,
        levels: &[Level],
        rest: &[Vec<Vec4>],
        starts: &[usize],
        uniforms: &BindGroup,
        room: usize,
        [averages, shift]: [&wgpu::Buffer; 2],
    ) -> Option<TiledLevels> {
        let end = starts[levels.len()];
        let first_together = (0..levels.len()).find(|&level| end - starts[level] <= room).unwrap_or(levels.len());
        if levels[..first_together].iter().any(|level| level.sweeps > 1) {
            return None;
        }
        let mut in_tiles = Vec::new();
        for (index, level) in levels[..first_together].iter().enumerate() {
            let mut tiles = Tiles::new(
                &rest[index],
                &level.links,
                &level.colors,
                TileSize { own: OWN, room, bytes: gpu.most_table_bytes() },
            )?;
            let above = levels.get(index + 1);
            let label = |item: u32| above.map_or(NONE, |above| starts[index + 1] as u32 + above.label[item as usize]);
            tiles.set_labels(label, starts[index] as u32);
            let table = gpu.filled("tiles of a level", &tiles.table);
            let bound = vec![Bind::Read(&table), Bind::Read(averages), Bind::Write(shift)];
            let constants = [&tiles.constants(lanes(gpu, tiles.widest))[..], &[("LEVEL", index as f64)]].concat();
            let entry = Entry { shader: shaders::LEVEL_TILE, name: "sweep_of_level_tile", constants: &constants };
            let stage = Stage::new(gpu, uniforms, entry, &[bound]);
            in_tiles.push((tiles, table, stage));
        }
        let in_workgroup = (first_together < levels.len()).then(|| {
            let levels = LevelTable::new(levels, first_together, None);
            let table = gpu.filled("levels", &levels.table);
            let own = [("LANES", lanes(gpu, levels.width) as f64), ("BASE", starts[first_together] as f64)];
            let constants = [&LevelTable::constants(Some(&levels), 0)[..], &own].concat();
            let bound = vec![Bind::Read(&table), Bind::Read(averages), Bind::Write(shift)];
            let entry = Entry { shader: shaders::LEVELS_IN_WORKGROUP, name: "sweep_of_levels", constants: &constants };
            let stage = Stage::new(gpu, uniforms, entry, &[bound]);
            (levels, table, stage)
        });
        Some(TiledLevels { in_tiles, in_workgroup })
    }

    /// How many of this many levels are averaged separately: the workgroup averages all of its levels but the finest.
    pub(crate) fn averaged(&self, levels: usize) -> usize {
        levels.min(self.in_tiles.len() + 1)
    }

    pub(crate) fn send_edges(&mut self, gpu: &Gpu, levels: &[Vec<Edge>]) {
        for ((tiles, table, _), edges) in self.in_tiles.iter_mut().zip(levels) {
            tiles.send_edges(gpu, table, 0, edges);
        }
        if let Some((together, table, _)) = &mut self.in_workgroup {
            together.send_edges(gpu, table, 0, levels);
        }
    }

    /// Encodes the sweeps of this many levels, the coarsest first.
    pub(crate) fn encode(&self, pass: &mut ComputePass, levels: usize) {
        if let Some((_, _, stage)) = self.in_workgroup.as_ref().filter(|_| levels > self.in_tiles.len()) {
            stage.dispatch_workgroups(pass, 0, &[], 1);
        }
        let in_tiles = self.in_tiles.iter().take(levels).rev();
        in_tiles.for_each(|(tiles, _, stage)| stage.dispatch_workgroups(pass, 0, &[], tiles.count));
    }
}
