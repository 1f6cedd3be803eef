//! The kernels run by wgpu: all substeps of a step in one encoder and one submit, nothing read back until asked for.
//!
//! A [`Gpu`] lives as long as the program, [`GpuEngine`] and its buffers as long as the cloth, [`Plan`] for one step.
//!
//! Practice: a dependent dispatch costs about 2 us on a large GPU, whatever it does, so a step is made of few. A small cloth
//! is one workgroup's work, a step in one dispatch ([`sweep::Whole`]). Any other is cut into [`patches`], a substep in one
//! dispatch ([`sweep::Halo`]); bending and wind, which look at whole rings, come before it in dispatches of their own.
//! Where neither will do there is a dispatch a colour ([`sweep::Colours`]). A step works on copies and is committed at its
//! end if all of it is within bounds, so a step that fails leaves the cloth as it was.

mod device;
mod forces;
mod patches;
#[cfg(test)]
mod paths;
mod sweep;

use glam::Vec4;

use crate::cloth::Cloth;
use crate::engine::Failure;
use crate::options::Method;
use crate::plan::Plan;
pub use device::Gpu;
#[cfg(test)]
pub(crate) use device::WORKGROUP;
pub(crate) use device::shader;
use device::{Bind, Entry, Sent, Stage};
pub(crate) use forces::Forces;
use patches::Patches;
#[cfg(test)]
pub(crate) use sweep::Batch;
use sweep::{Colours, Halo, TURNS, Whole, turn};

/// From this many vertices on a GPU beats the CPU: in `benches/results/table_h200.md` its 0.52 ms a frame are passed at
/// about 1240, and a part of the frame is spent elsewhere.
pub(crate) const WORTHWHILE: usize = 1536;

/// Rounded up so that a uniform of any size may start there.
const SLOT: u64 = 256;
/// Dispatches in one submit, about: a driver takes the device away from work that holds it for seconds.
const LONGEST_SUBMIT: usize = 16_384;
/// Sweeps in one dispatch, for the same reason.
const LONGEST_DISPATCH: u32 = 2048;
/// Vertices up to which one workgroup is faster than many.
const WHOLE_ALONE: usize = 1024;
/// Workgroups that a patch for each keeps a large GPU busy, and the own vertices that a patch has at least and at most.
const PATCHES: usize = 128;
const OWN: [usize; 2] = [48, 1024];
/// Bytes of workgroup memory that a vertex takes in a patch, and in a cloth of one.
const IN_PATCH: usize = 32;
const IN_WHOLE: usize = 12;
/// What `bounds.wgsl` calls none.
const NONE: u32 = u32::MAX;

/// A cloth on the GPU.
#[derive(Debug)]
pub(crate) struct GpuEngine {
    gpu: Gpu,
    forces: Forces,
    bodies: Sent,
    sweep: Sweep,
    /// If the cloth is small.
    whole: Option<Whole>,
    check: Stage,
    commit: Stage,
    first_bad: wgpu::Buffer,
    staging: wgpu::Buffer,
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
        GpuEngine::with_path(gpu, cloth, method, path, (vertices / PATCHES).clamp(OWN[0], OWN[1]))
    }

    /// With the best path up to `path`, patches having at most `own` vertices of their own.
    fn with_path(gpu: Gpu, cloth: &Cloth, method: Method, path: Path, own: usize) -> Result<GpuEngine, String> {
        gpu.clone().checked(|| {
            let vertices = cloth.rest.len();
            let size = size_of_val(cloth.rest.as_slice()) as u64;
            let forces = Forces::new(&gpu, cloth, 2)?;
            let bodies = sweep::bodies(&gpu);
            let first_bad = gpu.buffer("first_bad", 4);
            let memory = gpu.device.limits().max_compute_workgroup_storage_size as usize;
            let cut = |own, room| {
                let ends: Vec<[u32; 2]> = cloth.swept().iter().map(|link| link.ends).collect();
                Patches::new(&cloth.rest, &ends, &cloth.colors, own, room)
            };
            let whole = (path == Path::Whole).then(|| cut(vertices, (memory - 16) / IN_WHOLE)).flatten();
            let whole = whole.filter(|patches| patches.count == 1 && method != Method::Springs);
            let whole = whole.map(|patches| Whole::new(&gpu, patches, &forces, &bodies, &first_bad));
            let patches = (path != Path::Colours && method == Method::SmallSteps).then(|| cut(own, memory / IN_PATCH)).flatten();
            let sweep = match patches {
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
            let mut engine = GpuEngine { gpu, forces, bodies, sweep, whole, check, commit, first_bad, staging };
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

    /// Submits one step; returns before it is done.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        let gpu = self.gpu.clone();
        gpu.checked(|| {
            let path = self.path(plan);
            self.prepare(plan, path);
            self.submit(plan, path);
            Ok(())
        })
        .map_err(Failure::Gpu)
    }

    fn path(&self, plan: &Plan<'_>) -> Path {
        let gathers = plan.bending || plan.wind || plan.method == Method::Springs;
        let sweeps = plan.params.substeps.saturating_mul(plan.sweeps);
        match (&self.sweep, &self.whole) {
            (_, Some(_)) if !gathers && sweeps <= LONGEST_DISPATCH => Path::Whole,
            (Sweep::Halo(_), _) => Path::Halo,
            (Sweep::Colours(_), _) => Path::Colours,
        }
    }

    /// Uploads what the step needs and is not there yet.
    fn prepare(&mut self, plan: &Plan<'_>, path: Path) {
        let GpuEngine { gpu, forces, bodies, sweep, whole, first_bad, .. } = self;
        let moved = forces.prepare(gpu, plan, path == Path::Whole);
        if bodies.send(gpu, &plan.bodies) | moved {
            match sweep {
                Sweep::Colours(colours) => colours.rebind(gpu, forces, bodies),
                Sweep::Halo(halo) => halo.rebind(gpu, forces, bodies),
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
    }

    fn submit(&self, plan: &Plan<'_>, path: Path) {
        let last = plan.substeps.len() - 1;
        let dispatches = match &self.sweep {
            _ if path == Path::Whole => 0,
            Sweep::Colours(colours) => 4 + colours.dispatches(plan),
            Sweep::Halo(_) => 5,
        };
        let longest = (LONGEST_SUBMIT / dispatches.max(1)).max(1);
        for first in (0..=last).step_by(longest) {
            let mut encoder = self.gpu.encoder();
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            self.forces.set_frame(&mut pass, 0);
            if let (Path::Whole, Some(whole)) = (path, &self.whole) {
                whole.encode(&mut pass);
            } else {
                (first..=last).take(longest).for_each(|substep| self.encode(&mut pass, plan, substep));
            }
            drop(pass);
            self.gpu.queue.submit([encoder.finish()]);
            if path == Path::Whole {
                break;
            }
        }
    }

    /// Encodes one substep, and after the last the commit.
    fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, substep: usize) {
        let turn = turn(substep);
        let [from, to] = TURNS[turn];
        self.forces.set_frame(pass, substep);
        match &self.sweep {
            Sweep::Halo(halo) => {
                if plan.params.predicted != 0 {
                    self.forces.encode(pass, plan, from);
                }
                halo.encode(pass, plan, turn);
            }
            Sweep::Colours(colours) => {
                self.forces.encode(pass, plan, from);
                colours.encode(pass, plan, turn);
            }
        }
        if substep + 1 == plan.substeps.len() {
            let vertices = plan.cloth.rest.len();
            self.check.encode(pass, to - 1, &[], vertices);
            self.commit.encode(pass, to - 1, &[], vertices);
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
