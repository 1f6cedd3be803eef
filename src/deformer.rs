//! The deformer: a cloth, its state, and the substep loop from top to bottom.

use glam::{DVec3, Vec3, Vec4};

use crate::attributes::{Attributes, Collider};
use crate::cloth::Cloth;
use crate::coefficients::Coefficients;
use crate::cpu::{self, Cpu};
use crate::error::{BuildError, StepError};
use crate::fabric::Fabric;
#[cfg(feature = "gpu")]
use crate::gpu::{self, Gpu, GpuEngine};
#[cfg(feature = "gpu")]
use crate::hybrid::Hybrid;
use crate::kernels::{Body, Params, Pin, Substep};
use crate::measure::Measure;
use crate::mesh::Mesh;
use crate::quality::{MAX_SUBSTEPS, Rates};

/// Where the work is done. All three give the same motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// A real GPU if there is one and the mesh is large enough to gain from it, else the CPU.
    #[default]
    Auto,
    /// Rayon over vertices, and over the edges of one colour at a time.
    Cpu,
    /// Forces on the GPU, edges and contact on the CPU, every substep: the shape of the 2013 plug-in.
    Hybrid,
    /// Everything on the GPU; read back when asked for.
    Gpu,
}

/// How the edges hold together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Small-step XPBD, one sweep a substep, second order: see `NUMERICS` in the repository's README.
    #[default]
    SmallSteps,
    /// Position Verlet and Jakobsen relaxation (2001), the 2013 plug-in's own: stiffness depends on iterations and step.
    Relaxation {
        /// Sweeps a substep.
        iterations: u32,
    },
    /// Explicit leapfrog springs: accurate when resolved, unstable past the explicit limit.
    Springs,
}

/// How finely a step is divided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quality {
    /// This many substeps in each step.
    Substeps(u32),
    /// As many as keep the worst stretch strain below this, from closed forms (see [`crate::quality`]).
    Strain(f32),
}

impl Default for Quality {
    fn default() -> Quality {
        Quality::Strain(0.03)
    }
}

/// What is fixed when a [`Deformer`] is made.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Where the work is done.
    pub backend: Backend,
    /// How the edges hold together.
    pub method: Method,
    /// How finely a step is divided.
    pub quality: Quality,
    /// What the cloth is made of.
    pub fabric: Fabric,
    /// A device of the caller's, for [`Deformer::position_buffer`]; `None`: one is requested when needed.
    #[cfg(feature = "gpu")]
    pub gpu: Option<Gpu>,
    /// Vertices that move only as [`Attributes::pin_targets`] says; each at most once.
    pub pinned: Vec<u32>,
    /// Mass of each vertex [kg]; `None`: a third of each of its triangles' `density * area`.
    pub mass: Option<Vec<f32>>,
    /// Factor on `fabric.stretch` for each of [`Mesh::edges`], 0 or above: below 1 along the diagonals gives soft shear.
    ///
    /// Woven cloth shears at 20..100 N/m. A grid's shear stiffness is a quarter of its diagonals', `scale * stretch / 4`:
    /// 0.02 along the diagonals makes 25 N/m of 5 kN/m, and the cloth gives way along the bias as fabric does.
    pub edge_scale: Option<Vec<f32>>,
}

/// What one step did, known without reading anything back.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepReport {
    /// Substeps taken.
    pub substeps: u32,
    /// What the caller should know.
    pub warnings: Vec<Warning>,
}

/// Something a step met that is worth knowing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// Bending was softened at some vertices to stay stable at this substep.
    BendingLimited {
        /// Number of vertices.
        vertices: usize,
    },
    /// Explicit springs run past their stability limit.
    ExplicitLimit {
        /// Substeps taken.
        substeps: u32,
        /// Substeps that would be stable.
        needed: u32,
    },
}

/// A cloth in motion.
#[derive(Debug)]
pub struct Deformer {
    cloth: Cloth,
    options: Options,
    rates: Rates,
    engine: Engine,
    /// For the last length of substep.
    coefficients: Option<Coefficients>,
    motion: Motion,
    /// What the caller was shown last, in the mesh's order.
    positions: Vec<Vec3>,
    velocities: Vec<Vec3>,
    /// Whether it still is the state.
    shown: bool,
}

/// Where the state lives.
#[derive(Debug)]
enum Engine {
    Cpu(Cpu),
    #[cfg(feature = "gpu")]
    Hybrid(Box<Hybrid>),
    #[cfg(feature = "gpu")]
    Gpu(Box<GpuEngine>),
}

/// What the next step must know of the last.
#[derive(Debug, Clone, Default)]
struct Motion {
    /// Its substep [s]; 0 if there was none, which makes the first kick half a kick (leapfrog start).
    h: f32,
    /// Its colliders.
    colliders: Vec<Collider>,
    /// Its gravity [m/s²], which the potential energy refers to.
    gravity: Vec3,
    /// Where it left the pins [m], local.
    pins: Vec<Vec3>,
}

impl Motion {
    /// What displacements are divided by to give velocities [s]: the substep, or 1 where they were given as velocities.
    fn unit(&self) -> f32 {
        if self.h > 0.0 { self.h } else { 1.0 }
    }
}

/// All that an engine needs for one step.
#[derive(Debug)]
pub(crate) struct Plan<'a> {
    pub cloth: &'a Cloth,
    pub coefficients: &'a Coefficients,
    pub params: Params,
    pub substeps: Vec<Substep>,
    pub bodies: Vec<Body>,
    pub pins: Vec<Pin>,
    /// Sweeps over the edges in each substep.
    pub sweeps: u32,
    pub relaxation: bool,
    /// The force terms that the scene has.
    pub bending: bool,
    pub wind: bool,
    pub springs: bool,
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
        let motion = Motion::at_rest(&cloth);
        let velocities = vec![Vec3::ZERO; mesh.positions.len()];
        let positions = mesh.positions.clone();
        Ok(Deformer { cloth, options, rates, engine, coefficients: None, motion, positions, velocities, shown: true })
    }

    /// Advances by `dt` [s].
    ///
    /// # Errors
    /// If `dt` or an attribute is out of its range, or the motion left the finite numbers; the state is then as it was.
    /// On the GPU the last is found when the state is next read: it is then that of the last good step.
    pub fn step(&mut self, dt: f32, attributes: &Attributes) -> Result<StepReport, StepError> {
        if !(dt > 0.0 && dt.is_finite()) {
            return Err(StepError::TimeStep { dt });
        }
        attributes.validate(self.cloth.pinned.len())?;
        let substeps = self.rates.substeps(&self.cloth, &self.options, dt, attributes)?;
        let h = dt / substeps as f32;
        if h == 0.0 {
            return Err(StepError::TimeStep { dt });
        }
        if self.coefficients.as_ref().is_none_or(|coefficients| coefficients.h.to_bits() != h.to_bits()) {
            self.coefficients = Some(Coefficients::new(&self.cloth, &self.options, h));
        }
        let coefficients = self.coefficients.as_ref().expect("made above");
        let plan = plan(&self.cloth, &self.options, coefficients, &self.motion, substeps, attributes);
        self.engine.step(&plan).map_err(|failure| failure.named(&self.cloth, self.options.method))?;

        let limited = coefficients.bending_limited;
        let limited = (limited > 0).then_some(Warning::BendingLimited { vertices: limited });
        let shortfall = self.rates.explicit_shortfall(dt, substeps);
        let shortfall = shortfall.map(|needed| Warning::ExplicitLimit { substeps, needed });
        self.motion.h = h;
        self.motion.colliders.clone_from(&attributes.colliders);
        self.motion.gravity = attributes.gravity;
        if let Some(targets) = &attributes.pin_targets {
            self.motion.pins = targets.iter().map(|&target| target - self.cloth.origin).collect();
        }
        self.shown = false;
        Ok(StepReport { substeps, warnings: limited.into_iter().chain(shortfall).collect() })
    }

    /// Back to frame 1: rest positions, no velocity. What follows replays bit for bit.
    pub fn reset(&mut self) {
        self.motion = Motion::at_rest(&self.cloth);
        self.engine.set(&self.cloth.rest, &vec![Vec4::ZERO; self.cloth.rest.len()]);
        self.shown = false;
    }

    /// Positions [m], one per vertex, in the mesh's order. Reads back from the GPU when they changed.
    ///
    /// # Errors
    /// If the GPU was lost, or the motion left the finite numbers since the last look.
    pub fn positions(&mut self) -> Result<&[Vec3], StepError> {
        self.show()?;
        Ok(&self.positions)
    }

    /// Velocities [m/s], one per vertex, in the mesh's order, half a substep back (leapfrog).
    ///
    /// # Errors
    /// As [`Deformer::positions`].
    pub fn velocities(&mut self) -> Result<&[Vec3], StepError> {
        self.show()?;
        Ok(&self.velocities)
    }

    /// Puts the cloth somewhere else: positions [m] and velocities [m/s], one per vertex, in the mesh's order. Pins are
    /// held where this puts them; the rest shape stays the mesh's.
    ///
    /// # Errors
    /// If a list has another length or a value is not finite; the state is then as it was.
    pub fn set_state(&mut self, positions: &[Vec3], velocities: &[Vec3]) -> Result<(), StepError> {
        let vertices = self.cloth.rest.len();
        for (name, list) in [("positions", positions), ("velocities", velocities)] {
            let problem = if list.len() == vertices {
                let index = list.iter().position(|value| !value.is_finite());
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
        let pins = cloth.pinned.iter().map(|&vertex| x[vertex as usize].truncate()).collect();
        self.motion = Motion { h: 0.0, pins, ..std::mem::take(&mut self.motion) };
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
        let x: Vec<DVec3> = cloth.order.iter().map(|&v| (self.positions[v as usize] - cloth.origin).as_dvec3()).collect();
        let v: Vec<DVec3> = cloth.order.iter().map(|&v| self.velocities[v as usize].as_dvec3()).collect();
        let colliders: Vec<Collider> = self.motion.colliders.iter().map(|c| c.relative_to(cloth.origin)).collect();
        Ok(Measure::new(cloth, f64::from(self.options.fabric.bending), &x, &v, self.motion.gravity, &colliders))
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

    /// Number of colours of the edges: batches that are visited one after another in a sweep.
    #[must_use]
    pub fn colours(&self) -> usize {
        self.cloth.colors.len()
    }

    /// What is subtracted from positions before they are computed with [m]; 0 unless the mesh is far out.
    #[must_use]
    pub fn origin(&self) -> Vec3 {
        self.cloth.origin
    }

    /// The positions on the GPU, for a renderer on the same device: a `vec4<f32>` a vertex, xyz [m] less
    /// [`Deformer::origin`], in the order of [`Deformer::vertex_order`]. `None` unless the backend is [`Backend::Gpu`].
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn position_buffer(&self) -> Option<&wgpu::Buffer> {
        match &self.engine {
            Engine::Gpu(gpu) => Some(gpu.position_buffer()),
            _ => None,
        }
    }

    /// The mesh's index of each vertex of [`Deformer::position_buffer`].
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
        let (positions, velocities) = (&mut self.positions, &mut self.velocities);
        let read = self.engine.read(|x, p| {
            for (&vertex, (x, p)) in cloth.order.iter().zip(x.iter().zip(p)) {
                positions[vertex as usize] = x.truncate() + cloth.origin;
                velocities[vertex as usize] = p.truncate() / unit;
            }
        });
        read.map_err(|failure| failure.named(cloth, self.options.method))?;
        self.shown = true;
        Ok(())
    }
}

impl Motion {
    fn at_rest(cloth: &Cloth) -> Motion {
        let pins = cloth.pinned.iter().map(|&vertex| cloth.rest[vertex as usize].truncate()).collect();
        Motion { pins, ..Motion::default() }
    }
}

impl Options {
    /// Checks what does not depend on the mesh.
    pub(crate) fn check_numbers(&self) -> Result<(), BuildError> {
        let refuse = |name: &str, value: f32, remedy| Err(BuildError::Value { name: name.to_owned(), value, remedy });
        match self.quality {
            Quality::Substeps(count) if !(1..=MAX_SUBSTEPS).contains(&count) => {
                return refuse("quality: Substeps", count as f32, "must be 1 to 65536");
            }
            Quality::Strain(tolerance) if !(tolerance > 0.0 && tolerance.is_finite()) => {
                return refuse("quality: Strain", tolerance, "must be finite and above 0; 0.03 is three per cent");
            }
            _ => {}
        }
        match self.method {
            Method::Relaxation { iterations } if !(1..=MAX_SUBSTEPS).contains(&iterations) => {
                refuse("method: Relaxation iterations", iterations as f32, "must be 1 to 65536")
            }
            Method::Springs if self.fabric.stretch.is_infinite() => {
                refuse("fabric.stretch", self.fabric.stretch, "explicit springs cannot be inextensible; use SmallSteps")
            }
            _ => Ok(()),
        }
    }
}

/// What an engine reports when a step or a read did not work out.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The state is not finite from this vertex on, in the cloth's order.
    Unstable(usize),
    #[cfg(feature = "gpu")]
    Gpu(String),
}

impl Failure {
    fn named(self, cloth: &Cloth, method: Method) -> StepError {
        match self {
            Failure::Unstable(vertex) => {
                let remedy = match method {
                    Method::SmallSteps | Method::Relaxation { .. } => "use a shorter dt, more substeps or smaller attributes",
                    Method::Springs => "use more substeps (see Warning::ExplicitLimit), a softer fabric or SmallSteps",
                };
                StepError::Unstable { vertex: cloth.order[vertex] as usize, remedy }
            }
            #[cfg(feature = "gpu")]
            Failure::Gpu(reason) => StepError::Gpu { reason },
        }
    }
}

impl Engine {
    #[cfg(not(feature = "gpu"))]
    fn new(cloth: &Cloth, options: &Options) -> Result<Engine, BuildError> {
        let refuse = |backend| BuildError::NoGpu { backend, reason: "this build lacks the `gpu` feature".to_owned() };
        match options.backend {
            Backend::Auto | Backend::Cpu => Ok(Engine::Cpu(Cpu::new(cloth))),
            Backend::Hybrid => Err(refuse("Backend::Hybrid")),
            Backend::Gpu => Err(refuse("Backend::Gpu")),
        }
    }

    #[cfg(feature = "gpu")]
    fn new(cloth: &Cloth, options: &Options) -> Result<Engine, BuildError> {
        let find = |software| match &options.gpu {
            Some(gpu) => Ok(gpu.clone()),
            None => Gpu::request(software),
        };
        let refuse = |backend| move |reason| BuildError::NoGpu { backend, reason };
        Ok(match options.backend {
            Backend::Cpu => Engine::Cpu(Cpu::new(cloth)),
            Backend::Auto if cloth.rest.len() < gpu::WORTHWHILE => Engine::Cpu(Cpu::new(cloth)),
            Backend::Auto => match find(false).and_then(|gpu| GpuEngine::new(gpu, cloth)) {
                Ok(gpu) => Engine::Gpu(Box::new(gpu)),
                Err(_) => Engine::Cpu(Cpu::new(cloth)),
            },
            Backend::Hybrid => {
                let gpu = find(true).and_then(|gpu| Hybrid::new(gpu, cloth));
                Engine::Hybrid(Box::new(gpu.map_err(refuse("Backend::Hybrid"))?))
            }
            Backend::Gpu => {
                let gpu = find(true).and_then(|gpu| GpuEngine::new(gpu, cloth));
                Engine::Gpu(Box::new(gpu.map_err(refuse("Backend::Gpu"))?))
            }
        })
    }

    fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        match self {
            Engine::Cpu(cpu) => {
                let before = (cpu.x.clone(), cpu.p.clone());
                // One entry into the thread pool a step; each loop in it then costs a few microseconds, not a wake-up.
                if cpu.x.len() < cpu::PARALLEL {
                    cpu.step(plan)
                } else {
                    rayon::scope(|_| cpu.step(plan))
                }
                cpu.keep_or_restore(before)
            }
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => {
                let before = (hybrid.cpu.x.clone(), hybrid.cpu.p.clone());
                hybrid.step(plan)?;
                hybrid.cpu.keep_or_restore(before)
            }
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.step(plan),
        }
    }

    fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        match self {
            Engine::Cpu(cpu) => cpu.set(x, p),
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => hybrid.cpu.set(x, p),
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.set(x, p),
        }
    }

    /// Shows the state, `x` and `p`, to `look`.
    fn read(&mut self, look: impl FnOnce(&[Vec4], &[Vec4])) -> Result<(), Failure> {
        match self {
            Engine::Cpu(cpu) => look(&cpu.x, &cpu.p),
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => look(&hybrid.cpu.x, &hybrid.cpu.p),
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => gpu.read(look)?,
        }
        Ok(())
    }
}

/// Turns attributes into the numbers the kernels take. `motion` is where the last step left off.
fn plan<'a>(
    cloth: &'a Cloth,
    options: &Options,
    coefficients: &'a Coefficients,
    motion: &Motion,
    count: u32,
    attributes: &Attributes,
) -> Plan<'a> {
    let h = coefficients.h;
    let drag = f64::from(attributes.damping);
    // The kick spans from the middle of the last substep to the middle of this one; exact for linear drag.
    let substep = |index: u32| {
        let (last, unit) = if index == 0 { (motion.h, motion.unit()) } else { (h, h) };
        let kick = 0.5 * (f64::from(last) + f64::from(h));
        let gain = if drag > 0.0 { -(-drag * kick).exp_m1() / drag } else { kick };
        Substep {
            carry: ((-drag * kick).exp() * f64::from(h) / f64::from(unit)) as f32,
            gain: (gain * f64::from(h)) as f32,
            rate: 1.0 / unit,
            start: index as f32 / count as f32,
            end: (index + 1) as f32 / count as f32,
        }
    };
    let colliders = attributes.colliders.iter().enumerate();
    let bodies: Vec<Body> = colliders
        .map(|(index, collider)| collider.body(motion.colliders.get(index).unwrap_or(collider), cloth.origin, cloth.longest))
        .collect();
    let targets = attributes.pin_targets.iter().flatten();
    let pins: Vec<Pin> = targets
        .zip(&motion.pins)
        .zip(&cloth.pinned)
        .map(|((&to, from), &vertex)| Pin { origin: from.to_array(), vertex, goal: (to - cloth.origin).to_array(), padding: 0 })
        .collect();
    let params = Params {
        acceleration: (attributes.gravity + attributes.damping * attributes.wind).to_array(),
        h,
        wind: attributes.wind.to_array(),
        half_density: 0.5 * attributes.air_density,
        drag: attributes.drag,
        lift: attributes.lift,
        fraction: 1.0 / count as f32,
        vertices: cloth.rest.len() as u32,
        bodies: bodies.len() as u32,
        pins: pins.len() as u32,
        ..Params::default()
    };
    Plan {
        cloth,
        coefficients,
        params,
        substeps: (0..count).map(substep).collect(),
        bodies,
        pins,
        sweeps: match options.method {
            Method::SmallSteps => 1,
            Method::Relaxation { iterations } => iterations,
            Method::Springs => 0,
        },
        relaxation: matches!(options.method, Method::Relaxation { .. }),
        bending: options.fabric.bending > 0.0,
        wind: attributes.air_density > 0.0,
        springs: options.method == Method::Springs,
    }
}
