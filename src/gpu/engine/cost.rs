//! The amount of work in a step on the GPU: dispatches, bytes, colors and edges.

use glam::Vec4;

use super::{EdgeSweep, GpuEngine, Path};
use crate::gpu::commit;
use crate::gpu::forces::Forces;
use crate::gpu::stats::GpuStats;
use crate::gpu::sweep::PerColor;
use crate::step::plan::Plan;

impl GpuEngine {
    /// Dispatches of a substep.
    pub(super) fn dispatches(&self, plan: &Plan<'_>) -> usize {
        let levels = match self.multigrid(plan) {
            Some(_) if self.corrects_in_tiles(plan) => 1,
            Some(multigrid) => multigrid.dispatches(plan.params.levels as usize),
            None => 0,
        } - usize::from(self.multigrid(plan).is_some() && self.forces.averages(&self.forced(plan)));
        match &self.sweep {
            EdgeSweep::Tiled(_) => {
                let forced = self.forced(plan);
                self.forces.dispatches(&forced) * forced.params.predicted as usize + levels + 1
            }
            EdgeSweep::PerColor(per_color) => self.forces.dispatches(plan) + levels + per_color.dispatches(plan),
        }
    }

    /// The amount of work in the last step.
    #[cfg_attr(not(feature = "bench"), expect(dead_code, reason = "the benches ask"))]
    pub(crate) fn stats(&self) -> GpuStats {
        self.stats
    }

    pub(super) fn count(&self, plan: &Plan<'_>, path: Path) -> GpuStats {
        let state = 2 * size_of::<Vec4>() * plan.cloth.rest.len();
        let substeps = plan.substeps.len();
        if let (Path::SingleWorkgroup, Some(single)) = (path, &self.single_workgroup) {
            let [rounds, edges] = single.counts(plan).map(|count| substeps * count);
            return GpuStats { dispatches: 1, bytes: single.bytes() + 2 * state, rounds, edges };
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
            dispatches: substeps * self.dispatches(plan) + commit::DISPATCHES - usize::from(self.is_checked(plan)),
            bytes: substeps * (substep + multigrid.map_or(0, |multigrid| multigrid.bytes(levels))) + 3 * state,
            rounds: substeps * (rounds + more_rounds),
            edges: substeps * (edges + more_edges),
        }
    }
}
