//! The three engines behind one interface. The set is fixed, so this is an enum with a match and no trait.

#![cfg_attr(not(feature = "gpu"), expect(clippy::unnecessary_wraps, reason = "only a GPU can fail"))]

use glam::Vec4;

use crate::contact::Tally;
use crate::cpu::Cpu;
#[cfg(feature = "gpu")]
use crate::device::fault::{GpuFault, Need};
#[cfg(feature = "gpu")]
use crate::device::{Gpu, IN_BROWSER};
use crate::error::BuildError;
use crate::error::failure::Failure;
#[cfg(feature = "gpu")]
use crate::gpu::GpuEngine;
#[cfg(feature = "gpu")]
use crate::hybrid::Hybrid;
use crate::kernels::statistics::Statistics;
use crate::model::cloth::{Change, Cloth};
use crate::options::{Backend, Crossing, Options, Quality};
use crate::past::Past;
use crate::step::plan::Plan;

/// The latest statistics after a step, if its plan asks for them.
pub(crate) type Stepped = Result<Option<Statistics>, Failure>;

/// The engine in use, which holds the state.
pub(crate) enum Engine {
    Cpu(Box<Cpu>),
    #[cfg(feature = "gpu")]
    Hybrid(Box<Hybrid>),
    #[cfg(feature = "gpu")]
    Gpu(Box<GpuEngine>),
}

/// From this many vertices on a GPU is faster than the CPU: in `benches/results/gpu_h200.md`, at 20 substeps, an H200
/// takes 1.05 ms for 128 x 128 vertices and 16 cores take 1.60 ms; for 64 x 64 they take 0.79 ms and 0.58 ms.
#[cfg(feature = "gpu")]
const GPU_PAYS: usize = 16_384;
/// The same with contact of triangles: in `benches/results/contact.md`, at the default quality, an H100 takes 2.8 and 11
/// ms for a sheet of 64 x 64 vertices that hangs and one that falls into a heap, and 16 cores of its host take 5.6 and 31
/// ms. There it is faster from 400 vertices on, but smaller GPUs take as long for each of the many dispatches.
#[cfg(feature = "gpu")]
const GPU_PAYS_WITH_CONTACT: usize = 4096;

impl Engine {
    #[cfg(not(feature = "gpu"))]
    pub(crate) fn new(cloth: &Cloth, options: &Options) -> Result<Engine, BuildError> {
        let refuse =
            |backend| BuildError::NoGpu { backend, reason: "this build lacks the `gpu` feature; build with it".to_owned() };
        match options.backend {
            Backend::Auto | Backend::Cpu => Ok(Engine::Cpu(Box::new(Cpu::new(cloth)))),
            Backend::Hybrid => Err(refuse("Backend::Hybrid")),
            Backend::Gpu => Err(refuse("Backend::Gpu")),
        }
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn new(cloth: &Cloth, options: &Options) -> Result<Engine, BuildError> {
        let find = |software: bool| match &options.gpu {
            Some(gpu) if gpu.is_software() && !software => Err(GpuFault::other("it is a software driver")),
            Some(gpu) => Ok(gpu.clone()),
            None => Gpu::shared(software),
        };
        let of_gpu =
            |gpu| GpuEngine::new(gpu, cloth, options.method).and_then(|engine| engine.with_contact(cloth, options.contact));
        let refuse = |backend| {
            move |fault| match fault {
                GpuFault::Lost => {
                    let gpu = options.gpu.as_ref().map_or("the GPU", Gpu::name).to_owned();
                    BuildError::GpuLost { backend, gpu }
                }
                GpuFault::Memory(reason) => BuildError::GpuMemory { backend, reason },
                GpuFault::Limit(Need { thing, needed, limit, allowed }) => {
                    BuildError::GpuLimit { backend, thing, needed, limit, allowed }
                }
                GpuFault::Other(reason) => BuildError::NoGpu { backend, reason },
            }
        };
        Ok(match options.backend {
            Backend::Cpu => Engine::Cpu(Box::new(Cpu::new(cloth))),
            Backend::Auto if !gpu_pays(cloth, options) => Engine::Cpu(Box::new(Cpu::new(cloth))),
            Backend::Auto => match find(false).and_then(of_gpu) {
                Ok(gpu) => Engine::Gpu(Box::new(gpu)),
                Err(_) => Engine::Cpu(Box::new(Cpu::new(cloth))),
            },
            Backend::Hybrid if IN_BROWSER => {
                let reason = "it waits for the GPU, which a browser does not; ask for Backend::Gpu".to_owned();
                return Err(BuildError::NoGpu { backend: "Backend::Hybrid", reason });
            }
            Backend::Hybrid => {
                let gpu = find(true).and_then(|gpu| Hybrid::new(gpu, cloth));
                Engine::Hybrid(Box::new(gpu.map_err(refuse("Backend::Hybrid"))?))
            }
            Backend::Gpu if IN_BROWSER && options.contact.is_some() => {
                let remedy =
                    "must wait for the GPU in each step, which a browser does not allow; use Backend::Cpu, or no contact";
                return Err(BuildError::value("contact", "with Backend::Gpu", remedy));
            }
            Backend::Gpu => Engine::Gpu(Box::new(find(true).and_then(of_gpu).map_err(refuse("Backend::Gpu"))?)),
        })
    }

    /// Fails if this engine does not support the quality.
    pub(crate) fn check(&self, quality: Quality) -> Result<(), BuildError> {
        match (self, quality) {
            #[cfg(feature = "gpu")]
            (Engine::Gpu(_), Quality::Budget(time)) => Err(BuildError::value(
                "quality: Budget",
                time,
                "is not available on Backend::Gpu, whose steps return before they are done; use Quality::Hold, or Backend::Cpu or Hybrid",
            )),
            _ => Ok(()),
        }
    }

    /// Takes a step.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Stepped {
        match self {
            Engine::Cpu(cpu) => cpu.step(plan, None).map(|()| cpu.statistics(plan)),
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => hybrid.step(plan).map(|()| hybrid.cpu.statistics(plan)),
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.step(plan).and_then(|()| gpu.statistics()),
        }
    }

    /// Takes a step with each engine: those on a GPU are submitted together, the others run one after another.
    pub(crate) fn step_all(jobs: Vec<(&mut Engine, Plan<'_>)>) -> Vec<Stepped> {
        #[cfg(feature = "gpu")]
        let mut together = Vec::new();
        let mut done = Vec::new();
        for (index, (engine, plan)) in jobs.into_iter().enumerate() {
            done.push(Ok(None));
            match engine {
                #[cfg(feature = "gpu")]
                Engine::Gpu(gpu) => match gpu.check_whole() {
                    Ok(()) if gpu.waits_for(&plan) => {
                        done[index] = gpu.step(&plan).and_then(|()| gpu.statistics());
                    }
                    Ok(()) => together.push((index, &mut **gpu, plan)),
                    Err(failure) => done[index] = Err(failure),
                },
                engine => done[index] = engine.step(&plan),
            }
        }
        #[cfg(feature = "gpu")]
        let failures = GpuEngine::step_all(&mut together);
        #[cfg(feature = "gpu")]
        for (index, gpu, _) in together {
            let failure = failures.iter().find(|(failed, _)| *failed == index);
            done[index] = failure.map_or_else(|| gpu.statistics(), |(_, failure)| Err(failure.clone()));
        }
        done
    }

    /// Whether an earlier step is now known to have failed although it returned no error. Never waits.
    pub(crate) fn has_failed_late(&mut self) -> Result<bool, Failure> {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.has_failed_late(),
            _ => Ok(false),
        }
    }

    /// Counts of contact in the last step, if there is any.
    pub(crate) fn contact(&self) -> Option<Tally> {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.contact.as_ref().map(|contact| contact.tally()),
            _ => Some(self.cpu()?.contact.as_ref()?.tally),
        }
    }

    /// Intersections known to contact: those of the cloth with itself, and for each intersection with a body the index
    /// of the body.
    pub(crate) fn crossings(&self) -> (Vec<Crossing>, Vec<usize>) {
        let found = match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.contact.as_ref().map(|contact| contact.on_cpu.crossings.all(&contact.on_cpu.surface)),
            _ => self.cpu().and_then(|cpu| cpu.contact.as_ref()).map(|contact| contact.crossings.all(&contact.surface)),
        };
        found.unwrap_or_default()
    }

    /// Whether cloth got through something unlisted in a step on the processor, where nothing crossed before. A GPU takes such a step
    /// again by itself.
    pub(crate) fn has_crossed(&self) -> bool {
        self.cpu().and_then(|cpu| cpu.contact.as_ref()).is_some_and(|contact| contact.crossings.have_arisen())
    }

    /// What the processor computes; `None` if a GPU does everything.
    fn cpu(&self) -> Option<&Cpu> {
        match self {
            Engine::Cpu(cpu) => Some(cpu),
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => Some(&hybrid.cpu),
            #[cfg(feature = "gpu")]
            Engine::Gpu(_) => None,
        }
    }

    /// The same, to be changed.
    #[cfg_attr(not(feature = "gpu"), expect(clippy::unnecessary_wraps, reason = "without a GPU there is always one"))]
    pub(crate) fn cpu_mut(&mut self) -> Option<&mut Cpu> {
        match self {
            Engine::Cpu(cpu) => Some(cpu),
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => Some(hybrid.cpu_mut()),
            #[cfg(feature = "gpu")]
            Engine::Gpu(_) => None,
        }
    }

    /// Undoes the last step, on a GPU only one with contact.
    pub(crate) fn roll_back(&mut self) {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.roll_back(),
            _ => self.cpu_mut().into_iter().for_each(Cpu::roll_back),
        }
    }

    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.set(x, p),
            _ => self.cpu_mut().into_iter().for_each(|cpu| cpu.set(x, p)),
        }
    }

    /// Replaces the state that was set, before any step from it. What else the engine knows stays.
    pub(crate) fn put(&mut self, x: &[Vec4], p: &[Vec4]) {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.put(x, p, 0),
            _ => self.cpu_mut().into_iter().for_each(|cpu| cpu.put(x, p)),
        }
    }

    /// Replaces the displacements between steps.
    pub(crate) fn put_displacements(&mut self, p: &[Vec4]) {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.put_displacements(p),
            _ => self.cpu_mut().into_iter().for_each(|cpu| cpu.put_displacements(p)),
        }
    }

    /// What the engine knows besides positions and displacements.
    pub(crate) fn past(&mut self) -> Result<Past, Failure> {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.past(),
            _ => Ok(self.cpu().map(Cpu::past).unwrap_or_default()),
        }
    }

    /// Continues from a state and a past. Returns false and changes nothing if they cannot belong to this cloth.
    pub(crate) fn resume(
        &mut self,
        cloth: &Cloth,
        options: &Options,
        [x, p]: [&[Vec4]; 2],
        past: &Past,
    ) -> Result<bool, Failure> {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.resume(cloth, options.contact, [x, p], past),
            _ => Ok(self.cpu_mut().is_some_and(|cpu| cpu.resume(cloth, options.contact, [x, p], past))),
        }
    }

    /// Replaces the cloth by its changed version, with the same state but other inverse masses. Changes nothing if it
    /// fails.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "a CPU knows the cloth from each step"))]
    pub(crate) fn change(
        &mut self,
        cloth: &Cloth,
        options: &Options,
        change: Change,
        state: [&[Vec4]; 2],
    ) -> Result<(), Failure> {
        match self {
            Engine::Cpu(cpu) => cpu.change(change, state),
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => hybrid.change(cloth, change, state)?,
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.change(cloth, options.method, change, state)?,
        }
        Ok(())
    }

    /// SIMD lanes of the processor; `None` if it computes nothing.
    pub(crate) fn lanes(&self) -> Option<usize> {
        self.cpu().map(Cpu::lanes)
    }

    /// Requests the positions without waiting; false if there is nothing to wait for.
    pub(crate) fn request(&mut self) -> Result<bool, Failure> {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.request().map(|()| true),
            _ => Ok(false),
        }
    }

    /// Passes the requested positions to `read` if they have arrived; returns whether they have.
    pub(crate) fn arrived(&mut self, read: impl FnOnce(&[Vec4])) -> Result<bool, Failure> {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.arrived(read),
            _ => {
                drop(read);
                Ok(false)
            }
        }
    }

    /// Passes the state, positions `x` and displacements `p`, to `read`.
    pub(crate) fn read(&mut self, read: impl FnOnce(&[Vec4], &[Vec4])) -> Result<(), Failure> {
        match self {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.read(read)?,
            _ => self.cpu().map_or((), |cpu| read(&cpu.x, &cpu.p)),
        }
        Ok(())
    }
}

/// Whether a hardware GPU is expected to be faster than the CPU.
#[cfg(feature = "gpu")]
fn gpu_pays(cloth: &Cloth, options: &Options) -> bool {
    let (least, may_wait) = match options.contact {
        Some(_) => (GPU_PAYS_WITH_CONTACT, !IN_BROWSER),
        None => (GPU_PAYS, true),
    };
    may_wait && cloth.rest.len() >= least && !matches!(options.quality, Quality::Budget(_))
}

#[cfg(all(test, feature = "gpu"))]
#[path = "../tests/unit/backend.rs"]
mod tests;
