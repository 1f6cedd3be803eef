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

/// What tiles do besides sweeping, as an index of `GpuEngine::more`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Besides {
    /// Bending in a single pass.
    Bending,
    /// Correcting by a single level.
    Correcting,
}

/// How a step is done.
#[derive(Debug, Clone, Copy)]
pub(super) struct Way {
    pub route: Route,
    pub besides: Option<Besides>,
    /// Whether the displacements are predicted before the sweep.
    pub predicted: bool,
}

impl Way {
    /// The part of a step that is computed before its sweep: not what tiles compute themselves.
    pub(super) fn forced<'a>(self, plan: &Plan<'a>) -> Plan<'a> {
        let params = Params { predicted: self.predicted.into(), ..plan.params };
        Plan { bending: plan.bending && self.besides != Some(Besides::Bending), params, ..*plan }
    }
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
        let [bends, air] = self.single_workgroup.as_ref().map_or([false; 2], SingleWorkgroup::forces);
        let wanted = [bends || plan.bending, air || plan.air];
        let has_levels = |single: &SingleWorkgroup| plan.levels.is_empty() || single.has_levels();
        let there = self.single_workgroup.as_ref().is_some_and(|single| has_levels(single) && wanted == [bends, air]);
        if !there && plan.method != Method::Springs {
            let made = SingleWorkgroup::new(&self.gpu, plan.cloth, plan.levels, wanted, self.inputs());
            self.single_workgroup = made.or(self.single_workgroup.take());
        }
    }

    /// The buffers that the sweep works on.
    fn inputs(&self) -> SweepInputs<'_> {
        let GpuEngine { forces, bodies, multigrid, commit, .. } = self;
        SweepInputs { forces, bodies, found: &commit.found, multigrid: multigrid.as_ref() }
    }

    /// Whether tiles may bend the cloth in this step. Levels average displacements with bending, and wind is computed
    /// together with it, so both need a prediction by a stage of its own.
    pub(super) fn may_bend_in_tiles(plan: &Plan<'_>) -> bool {
        let once = plan.coefficients.bending.passes.len() <= 1 && plan.params.levels == 0;
        plan.bending && once && !plan.air && plan.cloth.rest.len() <= BENT_IN_TILES
    }

    /// Prepares the tiles for steps with bending in a single pass.
    pub(super) fn make_bent(&self, plan: &Plan<'_>) {
        if let EdgeSweep::Tiled(tiled) = &self.sweep {
            self.more[Besides::Bending as usize].get_or_init(|| tiled.bent(&self.gpu, plan.cloth, self.inputs()).map(Box::new));
        }
    }

    /// Prepares the tiles for steps with a single level, unless that is too large for one workgroup: then tiles of its own
    /// overlap less.
    pub(super) fn make_corrected(&self, plan: &Plan<'_>) {
        if let (EdgeSweep::Tiled(tiled), [level, ..], 1) = (&self.sweep, plan.levels, plan.params.levels) {
            let fits = level.inverse_mass.len() <= self.max_aggregates;
            let make = || tiled.corrected(&self.gpu, plan.cloth, level, self.inputs()).map(Box::new);
            self.more[Besides::Correcting as usize].get_or_init(|| if fits { make() } else { None });
        }
    }

    /// How a step is done that takes this route, with the tiles that there are.
    pub(super) fn way(&self, plan: &Plan<'_>, route: Route) -> Way {
        let bends = GpuEngine::may_bend_in_tiles(plan).then_some(Besides::Bending);
        let corrects = (plan.params.levels == 1).then_some(Besides::Correcting);
        let are_made = |besides: &Besides| self.more[*besides as usize].get().is_some_and(Option::is_some);
        let besides = [bends, corrects].into_iter().flatten().find(are_made);
        let way = Way { route, besides, predicted: true };
        // The levels' averages include the pins' motion.
        let has_moving_pins = plan.params.levels > 0 && !plan.pins.is_empty();
        let predicted = !matches!(self.sweep, EdgeSweep::Tiled(_)) || way.forced(plan).has_forces() || has_moving_pins;
        Way { predicted, ..way }
    }

    /// The tiles that do the step.
    pub(super) fn tiled<'a>(&'a self, tiled: &'a Tiled) -> &'a Tiled {
        self.way.besides.and_then(|besides| self.more[besides as usize].get()?.as_deref()).unwrap_or(tiled)
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
