//! The kernels run by wgpu: all substeps of a step in one encoder and one submit, nothing read back until asked for.
//!
//! A [`Gpu`] lives as long as the program, [`GpuEngine`] and its buffers as long as the cloth, [`Plan`] for one step.
//!
//! Practice: a dependent dispatch costs about 2 us on a large GPU, whatever it does, so a step is made of few. A small cloth,
//! or each of a crowd, is one workgroup's work, a step in one dispatch ([`sweep::Whole`]). Any other is cut into [`patches`],
//! a substep in one dispatch ([`sweep::Halo`]); what looks farther comes before it in dispatches of its own: bending and
//! wind, and the [`coarse`] levels. Inside of a dispatch a colour costs .2 us if its edges are there when it is their turn,
//! and twice that if a lane has to wait for memory: see `runs.wgsl`.
//! Where neither will do there is a dispatch a colour ([`sweep::Colours`]). A step works on copies and is committed at its
//! end if all of it is within bounds, so a step that fails leaves the cloth as it was.

mod coarse;
mod device;
mod exchange;
mod forces;
#[cfg(test)]
mod layout;
mod normals;
mod patches;
#[cfg(test)]
mod paths;
mod snapshot;
mod sweep;
mod top;
mod work;

use glam::Vec4;

use crate::backend::Failure;
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::Level;
use crate::options::Method;
use crate::step::plan::Plan;
use coarse::Coarse;
#[cfg(test)]
pub(crate) use coarse::Member;
pub use device::Gpu;
#[cfg(test)]
pub(crate) use device::WORKGROUP;
pub(crate) use device::shader;
use device::{Bind, Entry, Sent, Stage};
pub(crate) use exchange::{Desk, Exchange, Parcel};
pub(crate) use forces::Forces;
use normals::Normals;
pub use normals::Surface;
use patches::{Cut, Patches};
use snapshot::Snapshot;
#[cfg(test)]
pub(crate) use sweep::Batch;
use sweep::{Colours, Halo, TURNS, Whole, turn};
pub use work::GpuWork;
use work::Work;

/// From this many vertices on a GPU beats the CPU: in `benches/results/gpu_h200.md`, at 20 substeps, the H200 takes .90 ms for
/// 128 x 128 and 16 cores 1.03, and .64 against .56 for 64 x 64.
pub(crate) const WORTHWHILE: usize = 16_384;

/// Rounded up so that a uniform of any size may start there.
const SLOT: u64 = 256;
/// Sweeps in one dispatch: a driver takes the device away from work that holds it for seconds.
const LONGEST_DISPATCH: u32 = 2048;
/// Vertices up to which one workgroup is faster than many, and cloths of any size from which one each is.
const WHOLE_ALONE: usize = 1024;
const CROWD: usize = 4;
/// Workgroups that a patch for each keeps a large GPU busy, and the own vertices that a patch has at least and at most.
const PATCHES: usize = 256;
const OWN: [usize; 2] = [48, 256];
/// Bytes of workgroup memory that a vertex takes in a patch, and in a cloth of one; and there an aggregate.
const IN_PATCH: usize = 32;
const IN_WHOLE: usize = 12;
const IN_LEVELS: usize = 40;
/// What `bounds.wgsl` calls none.
const NONE: u32 = u32::MAX;

/// Patches of a cloth, if it can be cut.
fn cut(cloth: &Cloth, most: Cut) -> Option<Patches> {
    let ends: Vec<[u32; 2]> = cloth.swept().iter().map(|link| link.ends).collect();
    Patches::new(&cloth.rest, &ends, &cloth.colors, most)
}

/// A cloth on the GPU.
#[derive(Debug)]
pub(crate) struct GpuEngine {
    gpu: Gpu,
    forces: Forces,
    bodies: Sent,
    sweep: Sweep,
    /// If levels are in use.
    coarse: Option<Coarse>,
    /// Vertices or aggregates that a workgroup has room for.
    room: usize,
    /// If the cloth is small.
    whole: Option<Whole>,
    check: Stage,
    commit: Stage,
    first_bad: wgpu::Buffer,
    staging: wgpu::Buffer,
    /// What was asked for and has not been seen.
    snapshot: Option<Snapshot>,
    /// Made when the cloth is first drawn.
    normals: Option<Normals>,
    /// What the last step came to.
    counted: GpuWork,
}

/// How a substep's edges are swept.
#[derive(Debug)]
enum Sweep {
    Colours(Colours),
    Halo(Halo),
}

/// How a step is done; tests force one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Path {
    Colours,
    Halo,
    Whole,
}

impl GpuEngine {
    pub(crate) fn new(gpu: Gpu, cloth: &Cloth, method: Method) -> Result<GpuEngine, String> {
        let vertices = cloth.rest.len();
        let path = match method {
            _ if vertices <= WHOLE_ALONE => Path::Whole,
            Method::SmallSteps => Path::Halo,
            _ => Path::Colours,
        };
        let room = gpu.device.limits().max_compute_workgroup_storage_size as usize / IN_PATCH;
        GpuEngine::with_path(gpu, cloth, method, path, Cut { own: (vertices / PATCHES).clamp(OWN[0], OWN[1]), room })
    }

    /// With the best path up to `path`.
    fn with_path(gpu: Gpu, cloth: &Cloth, method: Method, path: Path, most: Cut) -> Result<GpuEngine, String> {
        gpu.clone().checked(|| {
            let vertices = cloth.rest.len();
            let size = size_of_val(cloth.rest.as_slice()) as u64;
            let forces = Forces::new(&gpu, cloth, 2)?;
            let bodies = sweep::bodies(&gpu);
            let first_bad = gpu.buffer("first_bad", 4);
            let patches = (path != Path::Colours && method == Method::SmallSteps).then(|| cut(cloth, most));
            let sweep = match patches.flatten() {
                Some(patches) => Sweep::Halo(Halo::new(&gpu, patches, &forces, &bodies)),
                None => Sweep::Colours(Colours::new(&gpu, cloth, &forces, &bodies)),
            };

            let keeps = gpu.module("commit", shader!("bounds", "commit"));
            let [own, works @ ..] = forces.states.as_slice() else { unreachable!("Forces::new was asked for three states") };
            let made: Vec<_> = works.iter().map(|work| [(0, Bind::Read(&work.x)), (1, Bind::Read(&work.p))]).collect();
            let kept = [(2, Bind::Write(&own.x)), (3, Bind::Write(&own.p))];
            let checked = [(4, Bind::Write(&first_bad))];
            let bound: Vec<_> = made.iter().map(|made| [&made[..], &checked].concat()).collect();
            let check = Stage::new(&gpu, &forces.frame, Entry::new(&keeps, "check"), &bound);
            let bound: Vec<_> = made.iter().map(|made| [&made[..], &kept, &checked].concat()).collect();
            let commit = Stage::new(&gpu, &forces.frame, Entry::new(&keeps, "commit"), &bound);
            let staging = gpu.staging("state", 2 * size + 4);
            let whole = None;
            let coarse = None;
            let mut engine = GpuEngine {
                gpu,
                forces,
                bodies,
                sweep,
                coarse,
                room: most.room,
                whole,
                check,
                commit,
                first_bad,
                staging,
                snapshot: None,
                normals: None,
                counted: GpuWork::default(),
            };
            if path == Path::Whole {
                engine.make_whole(cloth, method, &[]);
            }
            engine.set(&cloth.rest, &vec![Vec4::ZERO; vertices]);
            Ok(engine)
        })
    }

    pub(crate) fn adapter(&self) -> &str {
        &self.gpu.name
    }

    pub(crate) fn position_buffer(&self) -> &wgpu::Buffer {
        &self.forces.states[0].x
    }

    /// Prepares for steps in one workgroup, if the cloth fits into one.
    fn make_whole(&mut self, cloth: &Cloth, method: Method, levels: &[Level]) {
        let storage = self.gpu.device.limits().max_compute_workgroup_storage_size as usize;
        let room = storage / IN_WHOLE;
        let there = self.whole.as_ref().is_some_and(|whole| whole.levels() == levels.len());
        if there || cloth.rest.len() > room || method == Method::Springs {
            return;
        }
        if IN_LEVELS * levels.iter().map(|level| level.inverse_mass.len()).sum::<usize>() > storage {
            return;
        }
        if let Some(patches) = cut(cloth, Cut { own: room, room }).filter(|patches| patches.count == 1) {
            let GpuEngine { gpu, forces, bodies, first_bad, .. } = &*self;
            self.whole = Some(Whole::new(gpu, patches, levels, &cloth.rest, forces, bodies, first_bad));
        }
    }

    /// Submits one step; returns before it is done.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        let device = self.gpu.device.clone();
        device::checked(&device, || {
            let path = self.prepare(plan, false);
            let mut work = Work::new(&self.gpu);
            self.encode(&mut work, plan, path);
            work.submit();
            Ok(())
        })
        .map_err(Failure::Gpu)
    }

    /// Submits a step of each, those on one device together; returns before they are done. The failures, by the number
    /// that each was given.
    ///
    /// Dispatches that share no buffer run side by side, so each of many small cloths is one workgroup's work.
    pub(crate) fn step_all(jobs: &mut [(usize, &mut GpuEngine, Plan<'_>)]) -> Vec<(usize, Failure)> {
        let mut failures = Vec::new();
        let crowd = jobs.len() >= CROWD;
        jobs.sort_by_key(|(_, engine, _)| engine.gpu.id());
        for together in jobs.chunk_by_mut(|(_, a, _), (_, b, _)| a.gpu.id() == b.gpu.id()) {
            let gpu = together[0].1.gpu.clone();
            let submitted = gpu.checked(|| {
                let mut work = Work::new(&gpu);
                let paths: Vec<Path> = together.iter_mut().map(|(_, engine, plan)| engine.prepare(plan, crowd)).collect();
                together.iter().zip(paths).for_each(|((_, engine, plan), path)| engine.encode(&mut work, plan, path));
                work.submit();
                Ok(())
            });
            if let Err(reason) = submitted {
                failures.extend(together.iter().map(|(index, _, _)| (*index, Failure::Gpu(reason.clone()))));
            }
        }
        failures
    }

    /// Dispatches and bytes of the last step.
    pub(crate) fn counted(&self) -> GpuWork {
        self.counted
    }

    fn count(&self, plan: &Plan<'_>, path: Path) -> GpuWork {
        let vertices = plan.cloth.rest.len();
        let state = 2 * size_of::<Vec4>() * vertices;
        let substeps = plan.substeps.len();
        if let (Path::Whole, Some(whole)) = (path, &self.whole) {
            let [rounds, edges] = whole.counts(plan).map(|count| substeps * count);
            return GpuWork { dispatches: 1, bytes: whole.bytes() + 2 * state, rounds, edges };
        }
        let coarse = self.coarse.as_ref().filter(|_| plan.params.levels > 0);
        let forces = if plan.params.predicted == 0 { 0 } else { Forces::bytes(plan) };
        let (substep, mut rounds, mut edges) = match &self.sweep {
            // A halo's vertices are read more than once; each is written once.
            Sweep::Halo(halo) => (forces + halo.patches.bytes() + state, halo.patches.colors, halo.patches.swept),
            Sweep::Colours(_) => (Forces::bytes(plan) + plan.sweeps as usize * 112 * plan.cloth.swept().len() + 2 * state, 0, 0),
        };
        if let Some([more_rounds, more_edges]) = coarse.map(Coarse::counts) {
            (rounds, edges) = (rounds + more_rounds, edges + more_edges);
        }
        GpuWork {
            dispatches: substeps * self.dispatches(plan) + 2,
            bytes: substeps * (substep + coarse.map_or(0, Coarse::bytes)) + 3 * state,
            rounds: substeps * rounds,
            edges: substeps * edges,
        }
    }

    /// Uploads what the step needs and is not there yet; returns how it is to be done, alone or in a crowd.
    fn prepare(&mut self, plan: &Plan<'_>, crowd: bool) -> Path {
        let levels = plan.coefficients.levels.len();
        if crowd || self.whole.is_some() {
            self.make_whole(plan.cloth, plan.method, plan.levels);
        }
        let path = self.path(plan, crowd);
        let GpuEngine { gpu, forces, bodies, sweep, coarse, room, whole, first_bad, .. } = self;
        let mut moved = forces.prepare(gpu, plan, path == Path::Whole);
        if levels > 0 && path != Path::Whole {
            if coarse.as_ref().is_none_or(|coarse| coarse.levels != levels) {
                moved = true;
                let room = matches!(sweep, Sweep::Halo(_)).then_some(*room);
                *coarse = Some(Coarse::new(gpu, plan.cloth, plan.levels, forces, room));
                if let Sweep::Halo(halo) = sweep {
                    halo.set_labels(gpu, &plan.levels[0].label);
                }
            }
            coarse.as_mut().into_iter().for_each(|coarse| coarse.prepare(gpu, plan));
        }
        if bodies.send(gpu, plan.bodies) | moved {
            let shift = coarse.as_ref().map(|coarse| &coarse.shift);
            match sweep {
                Sweep::Colours(colours) => colours.rebind(gpu, forces, bodies),
                Sweep::Halo(halo) => halo.rebind(gpu, forces, bodies, shift),
            }
            if let Some(whole) = whole {
                whole.rebind(gpu, forces, bodies, first_bad);
            }
        }
        match (path, sweep, whole) {
            (Path::Whole, _, Some(whole)) => whole.prepare(gpu, plan),
            (_, Sweep::Colours(colours), _) => colours.prepare(gpu, plan),
            (_, Sweep::Halo(halo), _) => halo.prepare(gpu, plan),
        }
        self.counted = self.count(plan, path);
        path
    }

    fn path(&self, plan: &Plan<'_>, crowd: bool) -> Path {
        let gathers = plan.bending || plan.wind || plan.method == Method::Springs;
        // Levels have some more colours than the cloth, together.
        let sweeps = plan.params.substeps.saturating_mul(plan.sweeps + 4 * plan.params.levels.min(1));
        let pays = crowd || plan.cloth.rest.len() <= WHOLE_ALONE;
        match (&self.sweep, &self.whole) {
            (_, Some(whole))
                if pays && !gathers && sweeps <= LONGEST_DISPATCH && whole.levels() == plan.coefficients.levels.len() =>
            {
                Path::Whole
            }
            (Sweep::Halo(_), _) => Path::Halo,
            (Sweep::Colours(_), _) => Path::Colours,
        }
    }

    /// Encodes a step.
    fn encode(&self, work: &mut Work, plan: &Plan<'_>, path: Path) {
        if let (Path::Whole, Some(whole)) = (path, &self.whole) {
            let pass = work.room_for(1);
            self.forces.set_frame(pass, 0);
            whole.encode(pass);
            return;
        }
        let last = plan.substeps.len() - 1;
        let mut made = 0;
        for substep in 0..=last {
            let turn = turn(substep);
            let [from, to] = TURNS[turn];
            made = to;
            let pass = work.room_for(self.dispatches(plan));
            self.forces.set_frame(pass, substep);
            if plan.params.predicted != 0 || matches!(self.sweep, Sweep::Colours(_)) {
                self.forces.encode(pass, plan, from);
            }
            let coarse = self.coarse.as_ref().filter(|_| plan.params.levels > 0);
            if let Some(coarse) = coarse {
                coarse.encode(pass, plan, turn);
            }
            match &self.sweep {
                Sweep::Halo(halo) => halo.encode(pass, plan, turn),
                Sweep::Colours(colours) => {
                    coarse.into_iter().for_each(|coarse| coarse.encode_correct(pass, plan));
                    colours.encode(pass, plan, turn);
                }
            }
        }
        let pass = work.room_for(2);
        self.forces.set_frame(pass, last);
        self.check.encode(pass, made - 1, &[], plan.cloth.rest.len());
        self.commit.encode(pass, made - 1, &[], plan.cloth.rest.len());
    }

    /// Dispatches of a substep.
    fn dispatches(&self, plan: &Plan<'_>) -> usize {
        let coarse = self.coarse.as_ref().filter(|_| plan.params.levels > 0).map_or(0, Coarse::dispatches);
        match &self.sweep {
            Sweep::Halo(_) => Forces::dispatches(plan) * plan.params.predicted as usize + coarse + 1,
            Sweep::Colours(colours) => Forces::dispatches(plan) + coarse + 1 + colours.dispatches(plan),
        }
    }

    /// Puts the state somewhere else.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        let state = &self.forces.states[0];
        self.gpu.write(&state.x, x);
        self.gpu.write(&state.p, p);
        self.gpu.write(&self.first_bad, &[NONE]);
    }

    /// Waits for what was submitted.
    pub(crate) fn wait(&self) -> Result<(), Failure> {
        self.gpu.wait().map_err(Failure::Gpu)
    }

    /// Waits for the GPU and shows its state to `look`; then fails if it had to go back to that of an earlier step.
    /// Asks for the positions, in place of what was asked for before.
    pub(crate) fn request(&mut self) -> Result<(), Failure> {
        let snapshot = Snapshot::new(&self.gpu, &self.forces.states[0].x, &self.first_bad);
        self.snapshot = Some(snapshot.map_err(Failure::Gpu)?);
        Ok(())
    }

    /// Shows what was asked for to `look`, once, if it is there: whether it was.
    pub(crate) fn arrived(&mut self, look: impl FnOnce(&[Vec4])) -> Result<bool, Failure> {
        let Some(snapshot) = &self.snapshot else { return Ok(false) };
        let seen = snapshot.look(&self.gpu, |x, first_bad| {
            look(x);
            first_bad
        });
        let seen = seen.map_err(Failure::Gpu)?;
        if seen.is_some() {
            self.snapshot = None;
        }
        match seen {
            Some(vertex) if vertex != NONE => Err(Failure::Unstable(vertex as usize)),
            seen => Ok(seen.is_some()),
        }
    }

    pub(crate) fn read(&mut self, look: impl FnOnce(&[Vec4], &[Vec4])) -> Result<(), Failure> {
        let state = &self.forces.states[0];
        let size = state.x.size();
        let parts = [(&state.x, 0), (&state.p, size), (&self.first_bad, 2 * size)];
        let seen = self.gpu.read(&self.staging, &parts, self.gpu.encoder(), |bytes| {
            let (state, first_bad) = bytes.split_at(2 * size as usize);
            let first_bad: u32 = bytemuck::pod_read_unaligned(first_bad);
            let state: &[Vec4] = bytemuck::cast_slice(state);
            let (x, p) = state.split_at(state.len() / 2);
            look(x, p);
            first_bad
        });
        match seen.map_err(Failure::Gpu)? {
            NONE => Ok(()),
            vertex => {
                self.gpu.write(&self.first_bad, &[NONE]);
                Err(Failure::Unstable(vertex as usize))
            }
        }
    }
}
