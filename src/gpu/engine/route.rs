//! Which way a step is done: color by color, in tiles, or in one workgroup; and what each way needs besides.

use super::{EdgeSweep, GpuEngine};
use crate::device::Gpu;
use crate::gpu::sweep::{SingleWorkgroup, SweepInputs, Tiled};
use crate::gpu::tethers;
use crate::gpu::tiles::{IN_TILE, TileSize};
use crate::kernels::integrate::Pin;
use crate::kernels::params::Params;
use crate::model::cloth::Cloth;
use crate::options::Method;
use crate::step::plan::Plan;

/// Limit on the sweeps in one dispatch, because drivers reset a device that is busy with one dispatch for seconds. A sweep of
/// more than `COLORS` colors, as of a fan, counts as several.
const LONGEST_DISPATCH: u32 = 2048;
const COLORS: usize = 32;
/// Number of vertices up to which one workgroup is faster than many.
const SMALL: usize = 1024;
/// Number of workgroups, with a tile each, that keep a large GPU busy, and the range of a tile's own vertices.
const TILES: usize = 128;
const OWN: [usize; 2] = [48, 256];
/// Number of vertices up to which tiles bend the cloth before they sweep it. On an H200 a substep with bending then takes
/// 9.0 us instead of 15.7 at 4004 vertices, but 16 to 21 us instead of 16.8 at 14,161, because moments in the halo of the
/// sweep are computed in up to five tiles.
const BENT_IN_TILES: usize = 8192;

/// How a step is executed. Tests can force one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Route {
    PerColor,
    Tiled,
    SingleWorkgroup,
}

impl GpuEngine {
    pub(super) fn best(gpu: &Gpu, cloth: &Cloth, method: Method) -> (Route, TileSize) {
        let vertices = cloth.rest.len();
        let route = match method {
            _ if vertices <= SMALL => Route::SingleWorkgroup,
            Method::SmallSteps => Route::Tiled,
            _ => Route::PerColor,
        };
        let room = gpu.workgroup_memory() / IN_TILE;
        // The table has the tethers and the pins, too.
        let besides = tethers::size(cloth) + size_of::<u32>() * vertices + size_of::<Pin>() * cloth.pinned.len();
        let bytes = gpu.most_table_bytes().saturating_sub(besides);
        let size = TileSize { own: vertices.div_ceil(TILES).clamp(OWN[0], OWN[1]), room, bytes };
        (route, size)
    }

    /// Prepares for steps in one workgroup, if the cloth fits, with everything that this step and earlier ones use.
    pub(super) fn make_single_workgroup(&mut self, plan: &Plan<'_>) {
        let GpuEngine { gpu, forces, bodies, commit, single_workgroup, .. } = self;
        let [bends, air] = single_workgroup.as_ref().map_or([false; 2], SingleWorkgroup::forces);
        let wanted = [bends || plan.bending, air || plan.air];
        let has_levels = |single: &SingleWorkgroup| plan.levels.is_empty() || single.has_levels();
        let there = single_workgroup.as_ref().is_some_and(|single| has_levels(single) && wanted == [bends, air]);
        if !there && plan.method != Method::Springs {
            let bound = SweepInputs { forces, bodies, found: &commit.found, multigrid: None };
            let made = SingleWorkgroup::new(gpu, plan.cloth, plan.levels, wanted, bound);
            *single_workgroup = made.or(single_workgroup.take());
        }
    }

    /// Whether tiles may bend the cloth in this step. Levels average displacements with bending, and wind is computed
    /// together with it, so both need a prediction by a stage of its own.
    pub(super) fn may_bend_in_tiles(plan: &Plan<'_>) -> bool {
        let once = plan.coefficients.bending.passes.len() <= 1 && plan.params.levels == 0;
        plan.bending && once && !plan.air && plan.cloth.rest.len() <= BENT_IN_TILES
    }

    /// Prepares the tiles for steps with bending in a single pass.
    pub(super) fn make_bent(&mut self, plan: &Plan<'_>) {
        let GpuEngine { gpu, forces, bodies, sweep, bent, commit, .. } = self;
        if let EdgeSweep::Tiled(tiled) = sweep {
            let bound = SweepInputs { forces, bodies, found: &commit.found, multigrid: None };
            bent.make(|| tiled.bent(gpu, plan.cloth, bound));
        }
    }

    /// Prepares the tiles for steps with a single level, unless that is too large for one workgroup: then tiles of its own
    /// overlap less.
    pub(super) fn make_corrected(&mut self, plan: &Plan<'_>) {
        let GpuEngine { gpu, forces, bodies, sweep, corrected, multigrid, room, commit, .. } = self;
        if let (EdgeSweep::Tiled(tiled), [level, ..], 1) = (sweep, plan.levels, plan.params.levels) {
            let bound = SweepInputs { forces, bodies, found: &commit.found, multigrid: multigrid.as_ref() };
            let fits = level.inverse_mass.len() <= *room;
            corrected.make(|| fits.then(|| tiled.corrected(gpu, plan.cloth, level, bound)).flatten());
        }
    }

    /// Whether tiles correct the cloth by a level in this step.
    pub(super) fn corrects_in_tiles(&self, plan: &Plan<'_>) -> bool {
        plan.params.levels == 1 && self.corrected.made().is_some()
    }

    /// Whether tiles bend the cloth in this step.
    pub(super) fn bends_in_tiles(&self, plan: &Plan<'_>) -> bool {
        GpuEngine::may_bend_in_tiles(plan) && self.bent.made().is_some()
    }

    /// The tiles that do a step.
    pub(super) fn tiled<'a>(&'a self, tiled: &'a Tiled, plan: &Plan<'_>) -> &'a Tiled {
        let more = if self.bends_in_tiles(plan) { &self.bent } else { &self.corrected };
        let does = self.bends_in_tiles(plan) || self.corrects_in_tiles(plan);
        more.made().filter(|_| does).unwrap_or(tiled)
    }

    /// The part of a step that is computed before its sweep: not what tiles compute themselves.
    pub(super) fn forced<'a>(&self, plan: &Plan<'a>) -> Plan<'a> {
        let forced = Plan { bending: plan.bending && !self.bends_in_tiles(plan), ..*plan };
        // The levels' averages include the pins' motion.
        let has_moving_pins = plan.params.levels > 0 && !plan.pins.is_empty();
        let predicted = u32::from(!matches!(self.sweep, EdgeSweep::Tiled(_)) || forced.has_forces() || has_moving_pins);
        Plan { params: Params { predicted, ..plan.params }, ..forced }
    }

    /// Whether a single workgroup is the fastest route for the step of a cloth alone, or of one in a crowd.
    pub(super) fn may_be_small(&self, plan: &Plan<'_>, crowd: bool) -> bool {
        (crowd || self.small) && (self.joins_forces || !(plan.bending || plan.air))
    }

    pub(super) fn route(&self, plan: &Plan<'_>, crowd: bool) -> Route {
        // All levels together have a few more colors than the cloth. A pass of bending and the wind each take as long
        // as a sweep.
        let passes = if plan.bending { plan.coefficients.bending.passes_or_one().len() as u32 } else { 0 };
        // There and back in shells and tubes.
        let ways = 1 + u32::from(plan.cloth.sweeps_back);
        let sweeps = ways * plan.params.sweeps + 4 * plan.params.levels.min(1) + passes + u32::from(plan.air);
        let colors = plan.cloth.colors.len().div_ceil(COLORS) as u32;
        let lasts = plan.params.substeps.saturating_mul(sweeps).saturating_mul(colors);
        let pays = (crowd || plan.cloth.rest.len() <= SMALL) && self.may_be_small(plan, crowd);
        match (&self.sweep, &self.single_workgroup) {
            (_, Some(single)) if pays && !plan.has_contact() && lasts <= LONGEST_DISPATCH && single.does(plan) => {
                Route::SingleWorkgroup
            }
            (EdgeSweep::Tiled(_), _) => Route::Tiled,
            (EdgeSweep::PerColor(_), _) => Route::PerColor,
        }
    }
}
