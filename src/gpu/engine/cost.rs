//! The amount of work in a step on the GPU: dispatches, bytes, colors and edges.

use glam::Vec4;

use super::{EdgeSweep, GpuEngine, Route};
use crate::gpu::forces::Forces;
use crate::gpu::stats::GpuStats;
use crate::gpu::sweep::PerColor;
use crate::step::plan::Plan;

impl GpuEngine {
    /// The amount of work in the last step.
    #[cfg_attr(not(feature = "bench"), expect(dead_code, reason = "the benches ask"))]
    pub(crate) fn stats(&self) -> GpuStats {
        self.stats
    }

    /// The amount of work in a step, besides its dispatches, which are counted as they are encoded.
    pub(super) fn count(&self, plan: &Plan<'_>, route: Route) -> GpuStats {
        let state = 2 * size_of::<Vec4>() * plan.cloth.rest.len();
        let substeps = plan.substeps.len();
        if let (Route::SingleWorkgroup, Some(single)) = (route, &self.single_workgroup) {
            let [rounds, edges] = single.counts(plan).map(|count| substeps * count);
            return GpuStats { dispatches: 0, bytes: single.bytes() + 2 * state, rounds, edges };
        }
        let forced = self.forced(plan);
        let forces = Forces::bytes(&forced);
        let (substep, rounds, edges) = match &self.sweep {
            // Vertices in halos are read more than once; each vertex is written once.
            EdgeSweep::Tiled(tiled) => {
                let tiled = self.tiled(tiled, plan);
                let [colors, edges] = tiled.counts();
                (forces * forced.params.predicted as usize + tiled.bytes() + state, colors, edges)
            }
            EdgeSweep::PerColor(_) => (forces + PerColor::bytes(plan) + 2 * state, 0, 0),
        };
        let multigrid = self.multigrid(plan);
        let levels = plan.params.levels as usize;
        let apart = multigrid.filter(|_| !self.corrects_in_tiles(plan));
        let [more_rounds, more_edges] = apart.map_or([0, 0], |multigrid| multigrid.counts(levels));
        GpuStats {
            dispatches: 0,
            bytes: substeps * (substep + multigrid.map_or(0, |multigrid| multigrid.bytes(levels))) + 3 * state,
            rounds: substeps * (rounds + more_rounds),
            edges: substeps * (edges + more_edges),
        }
    }
}
