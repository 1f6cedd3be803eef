//! Bending and wind of a cloth that is stepped by one workgroup: their part of its table, as
//! `stages/forces_in_workgroup.wgsl` reads it.

use crate::device::Gpu;
use crate::gpu::bend_tiles::push_rings;
use crate::gpu::slices::push_slices;
use crate::kernels::bending::BendPass;
use crate::model::cloth::Cloth;
use crate::step::bending::MAX_PASSES;
use crate::step::plan::Plan;

/// Vectors that bending stores per vertex: `BEND_VECTORS` of the shader.
pub(crate) const BEND_VECTORS: usize = 6;

/// The forces that a table has data for, and where that starts.
pub(crate) struct ForceTable {
    pub bends: bool,
    pub air: bool,
    /// In words.
    bending: usize,
    wind: usize,
    panels: usize,
}

impl ForceTable {
    /// Appends the data of the forces to a table. [`ForceTable::send`] fills in the passes and rows, which depend on the substep.
    pub(crate) fn push(table: &mut Vec<u32>, cloth: &Cloth, [bends, air]: [bool; 2]) -> ForceTable {
        let (vertices, bending) = (cloth.rest.len(), table.len());
        if bends {
            let entries = &cloth.bending().entries;
            // The number of passes, the passes, and a row for each vertex.
            table.resize(bending + 1 + 4 * MAX_PASSES + 3 * vertices, 0);
            push_rings(table, vertices, |v| entries.of(v as u32), |vertex| vertex);
        }
        let wind = table.len();
        let panels = if air { cloth.panels().panels.len() } else { 0 };
        if air {
            let around = &cloth.panels().around;
            cloth.panels().panels.iter().for_each(|panel| table.extend(bytemuck::cast_slice::<_, u32>(&[*panel])));
            let list = |v: usize| around.of(v as u32).iter().map(|&panel| [panel]);
            push_slices(table, vertices, list, |_| [panels as u32]);
        }
        ForceTable { bends, air, bending, wind, panels }
    }

    /// The number of vectors that the forces store.
    pub(crate) fn vectors(&self, vertices: usize) -> usize {
        let bent = if self.bends { BEND_VECTORS * vertices } else { 0 };
        bent + if self.air { self.panels + 1 } else { 0 }
    }

    /// The values of the shader's overrides.
    pub(crate) fn constants(&self) -> [(&'static str, f64); 5] {
        [
            ("BENDS", f64::from(self.bends)),
            ("AIR", f64::from(self.air)),
            ("BENDING", self.bending as f64),
            ("WIND", self.wind as f64),
            ("PANELS", self.panels as f64),
        ]
    }

    /// Writes the passes and rows of a plan to a table.
    pub(crate) fn send(&self, gpu: &Gpu, plan: &Plan<'_>, table: &wgpu::Buffer) {
        if !self.bends {
            return;
        }
        let bending = &plan.coefficients.bending;
        let passes = bending.passes_or_one();
        let count = if plan.bending { passes.len() as u32 } else { 0 };
        let mut words = vec![count];
        words.extend(bytemuck::cast_slice::<_, u32>(passes));
        words.resize(1 + size_of::<BendPass>() / size_of::<u32>() * MAX_PASSES, 0);
        words.extend(bytemuck::cast_slice::<_, u32>(&bending.rows));
        gpu.write(table, size_of::<u32>() * self.bending, &words);
    }
}
