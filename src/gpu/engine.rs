//! A cloth on the GPU: prepares and submits steps. Which way a step is done is chosen in `route.rs`, its commands are in
//! `encode.rs`, access to the state between steps in `state.rs`, and steps with contact of the cloth with itself in
//! `contact.rs`.

mod contact;
mod encode;
mod route;
mod state;

use std::sync::{Arc, OnceLock};

use glam::Vec4;

use crate::device::fault::GpuFault;
use crate::device::{Gpu, IN_BROWSER};
use crate::error::failure::Failure;
use crate::gpu::commit::Commit;
use crate::gpu::contact::GpuContact;
use crate::gpu::forces::Forces;
use crate::gpu::multigrid::Multigrid;
use crate::gpu::readback::Readback;
use crate::gpu::stage::Sent;
use crate::gpu::state::StateBuffers;
use crate::gpu::statistics::Counter;
use crate::gpu::submission::Submission;
use crate::gpu::surface::Normals;
use crate::gpu::sweep::{OnDemand, PerColor, SingleWorkgroup, SweepInputs, Tiled};
use crate::gpu::tiles::{IN_LEVEL_TILE, IN_TILE, TileSize, Tiles};
use crate::gpu::watch::Report;
use crate::kernels::contact::Body;
use crate::model::cloth::{Change, Cloth};
use crate::options::Method;
use crate::step::plan::Plan;

#[cfg(test)]
pub(crate) use route::Besides;
pub(crate) use route::Route;
use route::Way;

/// Number of cloths stepped together on one device from which each is given one workgroup whatever its size.
const CROWD: usize = 4;

/// A cloth on the GPU.
pub(crate) struct GpuEngine {
    pub(crate) gpu: Gpu,
    pub(crate) forces: Forces,
    bodies: Sent,
    pub(crate) sweep: EdgeSweep,
    /// How the last step that was prepared is done.
    way: Way,
    /// The tiles that do more than sweep, for each of [`Besides`](route::Besides).
    pub(crate) more: [OnDemand; 2],
    /// Created when a step first uses levels.
    pub(crate) multigrid: Option<Multigrid>,
    /// Most aggregates of a tile.
    pub(crate) max_aggregates: usize,
    /// Whether a single workgroup is the fastest route even for a cloth alone. `single_workgroup` is created when a step
    /// first uses it.
    small: bool,
    /// Whether a single workgroup may also do bending and wind. A software driver compiles such a kernel for minutes, and anew
    /// for each mesh, so there the other routes are taken, also in a crowd.
    pub(crate) joins_forces: bool,
    pub(crate) single_workgroup: Option<SingleWorkgroup>,
    /// Contact of the cloth with itself and with mesh colliders, if it has any.
    pub(crate) contact: Option<Box<GpuContact>>,
    commit: Commit,
    readback: Readback,
    /// Created when statistics are first wanted; `counts` says whether those of the last step are.
    counter: Option<Counter>,
    counts: bool,
    report: Report,
    /// Created when the cloth is first drawn, or a render mesh bound to it.
    normals: OnceLock<Arc<Normals>>,
    /// Number of dispatches of the last step, each of which waits for the one before.
    pub(crate) dispatches: usize,
    /// The error that kept a step from being prepared. Later steps fail with it too, because buffers may be incomplete.
    broken: Option<GpuFault>,
}

/// How the edges are swept in a substep, unless a single workgroup does the step.
pub(crate) enum EdgeSweep {
    PerColor(PerColor),
    Tiled(Tiled),
}

impl GpuEngine {
    pub(crate) fn new(gpu: Gpu, cloth: &Cloth, method: Method) -> Result<GpuEngine, GpuFault> {
        let way = GpuEngine::best(&gpu, cloth, method);
        let mut engine = GpuEngine::make(gpu, cloth, method, way, None)?;
        engine.set(&cloth.rest, &vec![Vec4::ZERO; cloth.rest.len()]);
        Ok(engine)
    }

    /// Uses the fastest route that the cloth fits, at most `route`, on any driver.
    #[cfg(test)]
    pub(crate) fn with_route(
        gpu: Gpu,
        cloth: &Cloth,
        method: Method,
        route: Route,
        size: TileSize,
    ) -> Result<GpuEngine, GpuFault> {
        let mut engine = GpuEngine::make(gpu, cloth, method, (route, size), None)?;
        engine.joins_forces = true;
        engine.set(&cloth.rest, &vec![Vec4::ZERO; cloth.rest.len()]);
        Ok(engine)
    }

    /// With the given state, or with an uninitialized one.
    fn make(
        gpu: Gpu,
        cloth: &Cloth,
        method: Method,
        (route, size): (Route, TileSize),
        own: Option<StateBuffers>,
    ) -> Result<GpuEngine, GpuFault> {
        gpu.clone().checked(|| {
            let forces = Forces::new(&gpu, cloth, 2, own)?;
            let bodies = Sent::storage(&gpu, "bodies", size_of::<Body>());
            let tiled = route != Route::PerColor && method == Method::SmallSteps;
            let tiles = tiled.then(|| Tiles::new(&cloth.rest, cloth.swept(), &cloth.visits(), size));
            let commit = Commit::new(&gpu, &forces);
            let sweep = match tiles.flatten() {
                Some(tiles) => {
                    let bound = SweepInputs { forces: &forces, bodies: &bodies, found: &commit.found, multigrid: None };
                    EdgeSweep::Tiled(Tiled::new(&gpu, cloth, tiles, bound))
                }
                None => EdgeSweep::PerColor(PerColor::new(&gpu, cloth, &forces, &bodies)),
            };
            let readback = Readback::new(&gpu, &forces.states[0], &commit.found);
            Ok(GpuEngine {
                report: Report::new(&gpu),
                joins_forces: !gpu.is_software(),
                gpu,
                forces,
                bodies,
                sweep,
                way: Way { route, besides: None, predicted: true },
                more: Default::default(),
                multigrid: None,
                max_aggregates: size.room * IN_TILE / IN_LEVEL_TILE,
                small: route == Route::SingleWorkgroup,
                single_workgroup: None,
                contact: None,
                commit,
                readback,
                counter: None,
                counts: false,
                normals: OnceLock::new(),
                dispatches: 0,
                broken: None,
            })
        })
    }

    /// Continues with a cloth that was changed, at `x` with its inverse masses, in the same buffers, because renderers
    /// hold them.
    pub(crate) fn change(&mut self, cloth: &Cloth, method: Method, change: Change, [x, p]: [&[Vec4]; 2]) -> Result<(), Failure> {
        self.check_whole()?;
        if change == Change::Stiffness {
            self.forces.forget_springs();
            return Ok(());
        }
        let (gpu, own) = (self.gpu.clone(), self.forces.states[0].clone());
        let steps = gpu.checked(|| self.commit.read_found(&gpu))?.steps;
        let best = GpuEngine::best(&gpu, cloth, method);
        let mut made = GpuEngine::make(gpu, cloth, method, best, Some(own))?;
        // Edges between two pins have no strain gauges.
        let is_gauged_anew = change == Change::Edges && self.counter.is_some();
        let gauge = || Ok(is_gauged_anew.then(|| Counter::new(&made.gpu, &made.forces, cloth.gauges())));
        let gauged = made.gpu.checked(gauge)?;
        // Read-backs that are under way still arrive.
        std::mem::swap(&mut made.readback, &mut self.readback);
        (made.counter, made.counts, made.normals) = (self.counter.take(), self.counts, std::mem::take(&mut self.normals));
        made.counter.iter_mut().zip(gauged).for_each(|(counter, gauged)| counter.replace(gauged));
        made.contact = self.contact.take();
        made.contact.iter_mut().for_each(|contact| contact.unbind());
        *self = made;
        self.put(x, p, steps);
        Ok(())
    }

    /// Submits a step. Returns before it is done, unless it [waits](GpuEngine::waits_for).
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        self.check_whole()?;
        if self.waits_for(plan) { self.step_with(plan) } else { self.step_alone(plan) }
    }

    /// Whether a step waits for the GPU, because triangles touch, so that it cannot share a submission with others.
    pub(crate) fn waits_for(&self, plan: &Plan<'_>) -> bool {
        !IN_BROWSER && (self.contact.is_some() || plan.has_contact())
    }

    /// Submits a step without contact of triangles.
    fn step_alone(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        GpuEngine::step_all(&mut [(0, self, Plan { ..*plan })]).pop().map_or(Ok(()), |(_, failure)| Err(failure))
    }

    /// Fails if an earlier step could not be prepared.
    pub(crate) fn check_whole(&self) -> Result<(), Failure> {
        self.broken.clone().map_or(Ok(()), |fault| Err(Failure::Gpu(fault)))
    }

    fn break_off(&mut self, fault: GpuFault) -> Failure {
        self.broken = Some(fault.clone());
        Failure::Gpu(fault)
    }

    /// Submits a step of each cloth, those on one device together. Returns before they are done. Returns the failures
    /// by the number given with each cloth.
    ///
    /// Dispatches that share no buffer run concurrently, so each of many small cloths gets one workgroup.
    pub(crate) fn step_all(jobs: &mut [(usize, &mut GpuEngine, Plan<'_>)]) -> Vec<(usize, Failure)> {
        let mut failures = Vec::new();
        jobs.sort_by_key(|(_, engine, _)| engine.gpu.id());
        for together in jobs.chunk_by_mut(|(_, a, _), (_, b, _)| a.gpu.id() == b.gpu.id()) {
            let (gpu, crowd) = (together[0].1.gpu.clone(), together.len() >= CROWD);
            let submitted = gpu.checked(|| {
                let mut submission = if crowd { Submission::of_crowd(&gpu) } else { Submission::new(&gpu) };
                for (_, engine, plan) in together.iter_mut() {
                    engine.prepare(plan, crowd);
                    // A failure of one cloth fails this step for all of them. The others can be stepped again.
                    Gpu::refused().inspect_err(|fault| engine.broken = Some(fault.clone()))?;
                }
                for (_, engine, plan) in together.iter_mut() {
                    engine.dispatches = engine.encode(&mut submission, plan);
                }
                // After all steps: statistics wait for their step, and whatever is encoded later waits with them.
                for (_, engine, _) in together.iter_mut() {
                    engine.dispatches += engine.encode_statistics(&mut submission);
                }
                let submission = submission.submit_with(|encoder| {
                    together.iter_mut().for_each(|(_, engine, _)| engine.encode_copies(encoder));
                });
                together.iter_mut().for_each(|(_, engine, _)| engine.ask_for_copies(&submission));
                Ok(())
            });
            if let Err(reason) = submitted {
                // Whatever could not be made is incomplete, and of which cloth it is, is not known.
                if !matches!(reason, GpuFault::Limit(_)) {
                    together.iter_mut().for_each(|(_, engine, _)| engine.broken = Some(reason.clone()));
                }
                failures.extend(together.iter().map(|(index, _, _)| (*index, Failure::Gpu(reason.clone()))));
            }
        }
        failures
    }

    /// Uploads what the step needs, for a cloth alone or in a crowd.
    fn prepare(&mut self, plan: &Plan<'_>, crowd: bool) {
        let (route, has_new_levels) = self.make_stages(plan, crowd);
        self.way = self.way(plan, route);
        let averages = self.multigrid.as_ref().map(|multigrid| &multigrid.averages);
        let is_single = route == Route::SingleWorkgroup;
        let has_moved = self.forces.prepare(&self.gpu, &self.way.forced(plan), is_single, averages);
        if self.bodies.send(&self.gpu, plan.bodies_and_anchors) | has_moved | has_new_levels {
            self.rebind_sweep();
        }
        self.prepare_sweep(plan);
        if !is_single && !self.is_checked(plan) {
            self.commit.prepare(&self.gpu, plan.cloth, &self.forces);
        }
        self.prepare_counter(plan);
    }

    /// Makes the stages that the step needs and that do not exist yet. Returns its route, and whether the coarse levels are new.
    fn make_stages(&mut self, plan: &Plan<'_>, crowd: bool) -> (Route, bool) {
        if self.may_be_small(plan, crowd) && !plan.has_contact() {
            self.make_single_workgroup(plan);
        }
        let route = self.route(plan, crowd);
        if route == Route::Tiled && GpuEngine::may_bend_in_tiles(plan) {
            self.make_bent(plan);
        }
        if plan.coefficients.levels.is_empty() || route == Route::SingleWorkgroup {
            return (route, false);
        }
        let GpuEngine { gpu, forces, sweep, multigrid, max_aggregates, .. } = self;
        let are_new = multigrid.is_none();
        let multigrid = multigrid.get_or_insert_with(|| {
            if let EdgeSweep::Tiled(tiled) = sweep {
                tiled.set_labels(gpu, &plan.levels[0].label);
            }
            let max_aggregates = matches!(sweep, EdgeSweep::Tiled(_)).then_some(*max_aggregates);
            Multigrid::new(gpu, plan.cloth, plan.levels, forces, max_aggregates)
        });
        multigrid.prepare(gpu, plan);
        self.make_corrected(plan);
        (route, are_new)
    }

    /// Binds the sweep to buffers that are new.
    fn rebind_sweep(&mut self) {
        let GpuEngine { gpu, forces, bodies, sweep, more, multigrid, single_workgroup, commit, .. } = self;
        let bound = SweepInputs { forces, bodies, found: &commit.found, multigrid: multigrid.as_ref() };
        match sweep {
            EdgeSweep::PerColor(per_color) => per_color.rebind(gpu, forces, bodies),
            EdgeSweep::Tiled(tiled) => {
                let more = more.iter_mut().filter_map(|tiles| tiles.get_mut()?.as_deref_mut());
                std::iter::once(tiled).chain(more).for_each(|tiled| tiled.rebind(gpu, bound));
            }
        }
        if let Some(single) = single_workgroup {
            single.rebind(gpu, bound);
        }
    }

    /// Uploads the tables of the sweep.
    fn prepare_sweep(&mut self, plan: &Plan<'_>) {
        let GpuEngine { gpu, sweep, way, more, single_workgroup, .. } = self;
        match (way.route, sweep, single_workgroup) {
            (Route::SingleWorkgroup, _, Some(single)) => single.prepare(gpu, plan),
            (_, EdgeSweep::PerColor(per_color), _) => per_color.prepare(gpu, plan),
            (_, EdgeSweep::Tiled(tiled), _) => {
                let more = way.besides.and_then(|besides| more[besides as usize].get_mut()?.as_deref_mut());
                more.unwrap_or(tiled).prepare(gpu, plan);
            }
        }
    }

    /// Prepares the statistics of the step, if they are wanted.
    fn prepare_counter(&mut self, plan: &Plan<'_>) {
        let GpuEngine { gpu, forces, counter, counts, .. } = self;
        *counts = plan.gauges.is_some();
        if let Some(gauges) = plan.gauges {
            counter.get_or_insert_with(|| Counter::new(gpu, forces, gauges)).clear(gpu);
        }
    }
}
