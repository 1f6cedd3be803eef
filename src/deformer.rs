//! The deformer: a cloth, its state, and the substep loop from top to bottom.

#[cfg(feature = "bench")]
mod bench;

use glam::{DVec3, Vec3, Vec4};

use crate::attributes::{Attributes, Collider};
use crate::backend::Engine;
use crate::error::{BuildError, StepError};
use crate::failure::Failure;
#[cfg(feature = "gpu")]
use crate::gpu::Surface;
use crate::limits::{MAX_POSITION, MIN_TIME_STEP};
use crate::measure::Measure;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::multigrid::hierarchy::Hierarchy;
use crate::options::{Backend, Options, StepReport, Warning};
use crate::step::coefficients::Coefficients;
use crate::step::plan::{Motion, Plan, PlanBuffers};
use crate::step::substep_count::Rates;

/// A cloth in motion.
pub struct Deformer {
    cloth: Cloth,
    options: Options,
    rates: Rates,
    engine: Engine,
    /// The coarse levels, once a step wants any; and how many the last step asked for.
    hierarchy: Hierarchy,
    asked: usize,
    /// For the last length of substep.
    coefficients: Option<Coefficients>,
    motion: Motion,
    buffers: PlanBuffers,
    /// What the caller was shown last, in the mesh's order.
    positions: Vec<Vec3>,
    velocities: Vec<Vec3>,
    /// What the caller asked for, in the mesh's order; whether it is there, and not yet taken.
    requested: Vec<Vec3>,
    arrived: bool,
    /// The same positions as the cloth has them: far from the origin the caller's are coarser.
    local: Vec<Vec4>,
    /// What penetration is measured against: the colliders of the last step.
    colliders: Vec<Collider>,
    /// Gravity of the last step (m/s²), which the potential energy refers to.
    gravity: Vec3,
    /// Whether `positions`, `velocities` and `local` are of the state as it is.
    shown: bool,
}

impl std::fmt::Debug for Deformer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (vertices, edges) = (self.cloth.rest.len(), self.cloth.links.len());
        write!(f, "Deformer({vertices} vertices, {edges} edges, {:?}, {:?})", self.options.method, self.backend())
    }
}

impl Deformer {
    /// Builds the cloth and its state at frame 1: the mesh at rest.
    ///
    /// # Errors
    /// If the mesh or an option is out of its range, or the backend asked for has no GPU.
    pub fn new(mesh: &Mesh, options: Options) -> Result<Deformer, BuildError> {
        let cloth = Cloth::new(mesh, &options)?;
        let rates = Rates::new(&cloth, options.method);
        let engine = Engine::new(&cloth, &options)?;
        let motion = Motion::after(&cloth, &cloth.rest, 0.0);
        let local = cloth.rest.clone();
        let velocities = vec![Vec3::ZERO; mesh.positions.len()];
        let positions = mesh.positions.clone();
        Ok(Deformer {
            cloth,
            options,
            rates,
            engine,
            hierarchy: Hierarchy::default(),
            asked: 0,
            coefficients: None,
            motion,
            buffers: PlanBuffers::default(),
            positions,
            velocities,
            requested: Vec::new(),
            arrived: false,
            local,
            colliders: Vec::new(),
            gravity: Vec3::ZERO,
            shown: true,
        })
    }

    /// Advances by `dt` (s).
    ///
    /// # Errors
    /// If `dt` or an attribute is out of its range, or the motion left the finite numbers; the state is then as it was.
    /// On the GPU the last is found when the state is next read: it is then that of the last good step.
    pub fn step(&mut self, dt: f32, attributes: &Attributes) -> Result<StepReport, StepError> {
        let substeps = self.ready(dt, attributes)?;
        let (engine, plan) = self.job(substeps, attributes);
        let stepped = engine.step(&plan);
        self.stepped(stepped, dt, substeps, attributes)
    }

    /// Advances each of a crowd by `dt` (s), with its own attributes: `step_all(crowd.iter_mut().map(|one| (one, &all)), dt)`.
    ///
    /// Those on one GPU go to it together. A large GPU that a small cloth leaves mostly idle does many in little more
    /// than the time of one; the rest, and those on the CPU, are stepped one after another. In a crowd a cloth may be
    /// computed in another way than alone; then its motion differs by rounding.
    ///
    /// # Errors
    /// As [`Deformer::step`], for each on its own.
    pub fn step_all<'a>(
        crowd: impl IntoIterator<Item = (&'a mut Deformer, &'a Attributes)>,
        dt: f32,
    ) -> Vec<Result<StepReport, StepError>> {
        let mut crowd: Vec<_> = crowd.into_iter().collect();
        let ready: Vec<_> = crowd.iter_mut().map(|(one, attributes)| one.ready(dt, attributes)).collect();
        let jobs = crowd.iter_mut().zip(&ready);
        let jobs = jobs.filter_map(|((one, attributes), substeps)| Some(one.job(*substeps.as_ref().ok()?, attributes)));
        let mut stepped = Engine::step_all(jobs.collect()).into_iter();
        let each = crowd.into_iter().zip(ready);
        each.map(|((one, attributes), substeps)| {
            let substeps = substeps?;
            one.stepped(stepped.next().unwrap_or(Ok(())), dt, substeps, attributes)
        })
        .collect()
    }

    /// Checks a step and brings the coefficients up to date; returns its substeps.
    fn ready(&mut self, dt: f32, attributes: &Attributes) -> Result<u32, StepError> {
        if !(dt >= MIN_TIME_STEP && dt.is_finite()) {
            return Err(StepError::TimeStep { dt });
        }
        attributes.validate(self.cloth.pinned.len())?;
        let substeps = self.rates.substeps(&self.cloth, &self.options, dt, attributes)?;
        let h = dt / substeps as f32;
        let levels = self.rates.levels(&self.cloth, &self.options, h, attributes);
        if self.coefficients.as_ref().is_none_or(|last| last.h.to_bits() != h.to_bits() || self.asked != levels) {
            self.hierarchy.build(&self.cloth, levels);
            self.coefficients = Some(Coefficients::new(&self.cloth, self.hierarchy.finest(levels), &self.options, h));
            self.asked = levels;
        }
        Ok(substeps)
    }

    /// What the engine is to do, and the engine.
    fn job<'a>(&'a mut self, substeps: u32, attributes: &Attributes) -> (&'a mut Engine, Plan<'a>) {
        let coefficients = self.coefficients.as_ref().expect("a step is made ready first");
        let levels = self.hierarchy.finest(self.asked);
        let plan =
            Plan::new(&self.cloth, levels, &self.options, coefficients, &self.motion, substeps, attributes, &mut self.buffers);
        (&mut self.engine, plan)
    }

    /// Notes what a step leaves to the next.
    fn stepped(
        &mut self,
        stepped: Result<(), Failure>,
        dt: f32,
        substeps: u32,
        attributes: &Attributes,
    ) -> Result<StepReport, StepError> {
        stepped.map_err(|failure| failure.named(&self.cloth, self.options.method))?;
        let used = self.coefficients.as_ref().map(|used| (used.levels.len() as u32, used.bending_limited));
        let (levels, limited) = used.unwrap_or_default();
        let limited = (limited > 0).then_some(Warning::BendingLimited { vertices: limited });
        let shortfall = self.rates.explicit_shortfall(dt, substeps);
        let shortfall = shortfall.map(|needed| Warning::ExplicitLimit { substeps, needed });
        self.motion.h = dt / substeps as f32;
        self.motion.colliders.clone_from(&attributes.colliders);
        self.colliders.clone_from(&attributes.colliders);
        self.gravity = attributes.gravity;
        if let Some(targets) = &attributes.pin_targets {
            self.motion.pins.clear();
            self.motion.pins.extend(targets.iter().map(|&target| target - self.cloth.origin));
        }
        self.shown = false;
        Ok(StepReport { substeps, levels, warnings: limited.into_iter().chain(shortfall).collect() })
    }

    /// Back to frame 1: rest positions, no velocity. What follows replays bit for bit.
    pub fn reset(&mut self) {
        self.motion = Motion::after(&self.cloth, &self.cloth.rest, 0.0);
        (self.colliders, self.gravity) = (Vec::new(), Vec3::ZERO);
        self.engine.set(&self.cloth.rest, &vec![Vec4::ZERO; self.cloth.rest.len()]);
        self.shown = false;
    }

    /// Positions (m), one per vertex, in the mesh's order. Reads back from the GPU when they changed.
    ///
    /// # Errors
    /// If the GPU was lost, or the motion left the finite numbers since the last look.
    pub fn positions(&mut self) -> Result<&[Vec3], StepError> {
        self.show()?;
        Ok(&self.positions)
    }

    /// Asks for the positions after the steps so far, without waiting: more steps may be queued behind, and
    /// [`Deformer::requested_positions`] has them once they are there. What was asked for before and not taken is dropped.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn request_positions(&mut self) -> Result<(), StepError> {
        let under_way = self.engine.request().map_err(|failure| failure.named(&self.cloth, self.options.method))?;
        self.arrived = !under_way;
        if !under_way {
            self.show()?;
            self.requested.clone_from(&self.positions);
        }
        Ok(())
    }

    /// The positions (m) last asked for, one per vertex, in the mesh's order, once; `None` until they have arrived, and if
    /// none were asked for. Never waits.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn requested_positions(&mut self) -> Result<Option<&[Vec3]>, StepError> {
        let (cloth, requested) = (&self.cloth, &mut self.requested);
        let arrived = self.engine.arrived(|x| {
            requested.resize(x.len(), Vec3::ZERO);
            cloth.order.iter().zip(x).for_each(|(&vertex, x)| requested[vertex as usize] = x.truncate() + cloth.origin);
        });
        match arrived {
            Ok(arrived) => self.arrived |= arrived,
            Err(failure) => {
                // The same failure is found where the state is read, which also says what the next step starts from.
                self.show()?;
                return Err(failure.named(&self.cloth, self.options.method));
            }
        }
        Ok(std::mem::take(&mut self.arrived).then_some(&*self.requested))
    }

    /// Velocities (m/s), one per vertex, in the mesh's order, half a substep back (leapfrog).
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn velocities(&mut self) -> Result<&[Vec3], StepError> {
        self.show()?;
        Ok(&self.velocities)
    }

    /// Puts the cloth somewhere else: positions (m) and velocities (m/s), one per vertex, in the mesh's order. Pins are
    /// held where this puts them; the rest shape stays the mesh's.
    ///
    /// # Errors
    /// If a list has another length, or a value is not finite or beyond 1e15; the state is then as it was.
    pub fn set_state(&mut self, positions: &[Vec3], velocities: &[Vec3]) -> Result<(), StepError> {
        let vertices = self.cloth.rest.len();
        for (name, list) in [("positions", positions), ("velocities", velocities)] {
            let problem = if list.len() == vertices {
                let index = list.iter().position(|value| !value.abs().cmple(Vec3::splat(MAX_POSITION)).all());
                index.map(|index| format!("[{index}] is {}", list[index]))
            } else {
                Some(format!("{} values", list.len()))
            };
            if let Some(problem) = problem {
                return Err(StepError::State { name, problem, vertices });
            }
        }
        let cloth = &self.cloth;
        let local = |vertex: u32| positions[vertex as usize] - cloth.origin;
        let x: Vec<Vec4> = cloth.order.iter().zip(&cloth.rest).map(|(&vertex, rest)| local(vertex).extend(rest.w)).collect();
        let velocity = |(&vertex, rest): (&u32, &Vec4)| match rest.w > 0.0 {
            true => velocities[vertex as usize].extend(0.0),
            false => Vec4::ZERO,
        };
        let p: Vec<Vec4> = cloth.order.iter().zip(&cloth.rest).map(velocity).collect();
        self.motion = Motion::after(cloth, &x, 0.0);
        self.engine.set(&x, &p);
        self.shown = false;
        Ok(())
    }

    /// Strain, energy and penetration of the current state.
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn measure(&mut self) -> Result<Measure, StepError> {
        self.show()?;
        let cloth = &self.cloth;
        let x: Vec<DVec3> = self.local.iter().map(|x| x.truncate().as_dvec3()).collect();
        let v: Vec<DVec3> = cloth.order.iter().map(|&v| self.velocities[v as usize].as_dvec3()).collect();
        let colliders: Vec<Collider> = self.colliders.iter().map(|c| c.relative_to(cloth.origin)).collect();
        Ok(Measure::new(cloth, f64::from(self.options.fabric.bending), &x, &v, self.gravity, &colliders))
    }

    /// Waits until the steps so far are done, without reading anything back: for timing, and for renderers that share
    /// `Deformer::position_buffer` with another queue. The CPU is always done.
    ///
    /// # Errors
    /// If the GPU was lost.
    pub fn wait(&self) -> Result<(), StepError> {
        match &self.engine {
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.wait().map_err(|failure| failure.named(&self.cloth, self.options.method)),
            _ => Ok(()),
        }
    }

    /// The backend in use, never [`Backend::Auto`].
    #[must_use]
    pub fn backend(&self) -> Backend {
        match self.engine {
            Engine::Cpu(_) => Backend::Cpu,
            #[cfg(feature = "gpu")]
            Engine::Hybrid(_) => Backend::Hybrid,
            #[cfg(feature = "gpu")]
            Engine::Gpu(_) => Backend::Gpu,
        }
    }

    /// The GPU's name, if one is in use.
    #[must_use]
    pub fn adapter(&self) -> Option<&str> {
        match &self.engine {
            Engine::Cpu(_) => None,
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => Some(hybrid.adapter()),
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => Some(gpu.adapter()),
        }
    }

    /// Number of colors of the edges: batches that are visited one after another in a sweep.
    #[must_use]
    pub fn colors(&self) -> usize {
        self.cloth.colors.len()
    }

    /// What is subtracted from positions before they are computed with (m); 0 unless the mesh is far out.
    #[must_use]
    pub fn origin(&self) -> Vec3 {
        self.cloth.origin
    }

    /// The positions on the GPU, for a renderer on the same device (usages `VERTEX`, `STORAGE`, `COPY_SRC`): a `vec4<f32>` a vertex, xyz (m) less
    /// [`Deformer::origin`], in the order of [`Deformer::vertex_order`]. `None` unless the backend is [`Backend::Gpu`].
    /// [`Deformer::surface`] has normals and indices as well.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn position_buffer(&self) -> Option<&wgpu::Buffer> {
        match &self.engine {
            Engine::Gpu(gpu) => Some(gpu.position_buffer()),
            _ => None,
        }
    }

    /// The cloth as a renderer on the same device draws it: positions, normals and indices, nothing through the CPU.
    /// `None` unless the backend is [`Backend::Gpu`].
    ///
    /// Submits the normals' computation behind the steps so far, so call it each frame; what is drawn from the buffers
    /// must be submitted to the same queue, after this and before the next step. The first call builds what it needs; a
    /// cloth that is never drawn pays nothing.
    ///
    /// # Errors
    /// If the GPU was lost, or has no room.
    #[cfg(feature = "gpu")]
    pub fn surface(&mut self) -> Result<Option<Surface>, StepError> {
        match &mut self.engine {
            Engine::Gpu(gpu) => {
                let surface = gpu.surface(&self.cloth);
                surface.map(Some).map_err(|failure| failure.named(&self.cloth, self.options.method))
            }
            _ => Ok(None),
        }
    }

    /// The mesh's index of each vertex, in the order that the solver and `Deformer::position_buffer` have them in.
    #[must_use]
    pub fn vertex_order(&self) -> &[u32] {
        &self.cloth.order
    }

    /// Brings `positions` and `velocities` up to date.
    fn show(&mut self) -> Result<(), StepError> {
        if self.shown {
            return Ok(());
        }
        let cloth = &self.cloth;
        let unit = self.motion.unit();
        let (positions, velocities, local) = (&mut self.positions, &mut self.velocities, &mut self.local);
        let mut last_h = 0.0;
        let read = self.engine.read(|x, p| {
            local.clear();
            local.extend_from_slice(x);
            last_h = p[0].w;
            for (&vertex, (x, p)) in cloth.order.iter().zip(x.iter().zip(p)) {
                positions[vertex as usize] = x.truncate() + cloth.origin;
                velocities[vertex as usize] = p.truncate() / unit;
            }
        });
        if let Err(failure) = read {
            // The GPU has gone back to its last good state, and what the next step starts from goes with it.
            self.motion = Motion::after(cloth, &self.local, last_h);
            return Err(failure.named(cloth, self.options.method));
        }
        self.shown = true;
        Ok(())
    }
}
