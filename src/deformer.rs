//! The deformer: a cloth, and a step of it from top to bottom. What a step is said to be beforehand is in `forecast.rs`, the
//! state in the caller's terms in `state.rs`.

#[cfg(feature = "bench")]
mod bench;
mod change;
mod contact;
mod forecast;
mod quality;
mod sleep;
mod snapshot;
mod state;
mod untangle;
mod warp;

pub use forecast::Forecast;
use sleep::Stillness;
pub use snapshot::Snapshot;
pub use untangle::Untangled;

use std::collections::VecDeque;

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use web_time::Instant;

use crate::attributes::{Attributes, Collider};
use crate::backend::Engine;
use crate::error::{BuildError, StepError};
use crate::failure::Failure;
use crate::kernels::statistics::Statistics;
use crate::limits::MIN_TIME_STEP;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::multigrid::hierarchy::Hierarchy;
use crate::options::{Backend, Options, Quality, StepReport};
use crate::step::coefficients::Coefficients;
use crate::step::controller::Controller;
use crate::step::load::Load;
use crate::step::motion::Motion;
use crate::step::pace::Pace;
use crate::step::plan::{Plan, PlanBuffers};
use crate::step::substep_count::{Division, FRAMES, Rates};
use crate::step::watch::{Led, Watch};

/// Vertices up to which a cloth in a crowd is left to one thread: more threads would not halve its time.
const SMALL: usize = 4096;

/// What a step takes.
#[derive(Debug, Clone, Copy)]
struct Taken {
    /// Its length (s).
    dt: f32,
    load: Load,
    /// What decided on it.
    controller: Controller,
    /// Substeps a second that the quality came to.
    rate: f64,
    division: Division,
    /// Coarse levels it asks for.
    levels: usize,
}

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
    /// What decides on the substeps, and what steps that were not judged yet took.
    controller: Controller,
    unjudged: VecDeque<Taken>,
    /// The newest statistics there are.
    seen: Option<Statistics>,
    /// How long substeps take, where there is a budget for them.
    pace: Pace,
    still: Stillness,
    /// What the motion is judged by: as it is, and as it will be after a good step; and the bounds of the last.
    watch: Watch,
    meeting: (Watch, Led),
    bounds: (f32, f32),
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
        let rates = Rates::new(&cloth, &options);
        let engine = Engine::new(&cloth, &options)?;
        engine.check(options.quality)?;
        let motion = Motion::after(&cloth, &cloth.rest, 0.0);
        let watch = Watch::new(&cloth, &options);
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
            controller: Controller::default(),
            unjudged: VecDeque::new(),
            seen: None,
            pace: Pace::default(),
            still: Stillness::default(),
            watch,
            meeting: (watch, Led::default()),
            bounds: (f32::MAX, f32::MAX),
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

    /// Advances by `dt` (s). A step of 0 s checks its attributes and does nothing: what moves goes on from where it was before.
    ///
    /// On the CPU the threads of the current rayon pool share the work, and one that waits for another may run any other task of that
    /// pool meanwhile, as rayon does. So hold no lock across a step that a task of the same pool takes: the step may come to run
    /// that task itself, which waits for the lock, and so for the step, for ever. Where a lock must be held, give steps a pool of
    /// their own and enter it from a thread that is in no other pool: `pool.install(|| cloth.step(dt, &attributes))`.
    ///
    /// # Errors
    /// If `dt` or an attribute is out of its range, or the motion ran away ([`StepError::Unstable`]); the state is then as it was.
    /// On the GPU the last is found when the state is next read, or by one of the next steps, about sixteen later at most, which is then not
    /// taken: the state is that of the last good step.
    pub fn step(&mut self, dt: f32, attributes: &Attributes) -> Result<StepReport, StepError> {
        self.step_on(dt, attributes, false)
    }

    /// A step; on this thread `alone` or on as many as pay.
    fn step_on(&mut self, dt: f32, attributes: &Attributes, alone: bool) -> Result<StepReport, StepError> {
        let Some(taken) = self.ready(dt, attributes)? else { return Ok(idle(dt)) };
        // Without a budget nobody looks at a clock, which not every machine has.
        let start = (!alone && matches!(self.options.quality, Quality::Budget(_))).then(Instant::now);
        let (engine, plan) = self.job(&taken, attributes);
        let stepped = engine.step(&Plan { alone, ..plan });
        start.into_iter().for_each(|start| self.pace.note(start.elapsed().as_secs_f64(), taken.division.substeps));
        self.stepped(stepped, taken, attributes)
    }

    /// Advances each of a crowd by `dt` (s), with its own attributes: `step_all(crowd.iter_mut().map(|one| (one, &all)), dt)`.
    ///
    /// Those on one GPU go to it together. A large GPU that a small cloth leaves mostly idle does many in little more
    /// than the time of one. On the CPU small ones are stepped side by side, a thread each, if they are as many as the threads of the current
    /// rayon pool; the rest one after another, each on as many threads as pay. In a crowd a cloth may be
    /// computed in another way than alone on a GPU; then its motion differs by rounding. On the CPU it is the same bit for bit.
    ///
    /// # Errors
    /// As [`Deformer::step`], for each on its own.
    pub fn step_all<'a>(
        crowd: impl IntoIterator<Item = (&'a mut Deformer, &'a Attributes)>,
        dt: f32,
    ) -> Vec<Result<StepReport, StepError>> {
        let mut crowd: Vec<_> = crowd.into_iter().collect();
        let is_small = |one: &Deformer| matches!(one.engine, Engine::Cpu(_)) && one.cloth.rest.len() <= SMALL;
        let enough = rayon::current_num_threads().max(2);
        // No more are looked at than need be: that alone fetches each of a thousand from memory.
        if crowd.iter().filter(|(one, _)| is_small(one)).take(enough).count() < enough {
            return Deformer::step_together(crowd, dt);
        }
        let side_by_side = crowd.par_iter_mut().map(|(one, attributes)| is_small(one).then(|| one.step_on(dt, attributes, true)));
        let mut stepped: Vec<Option<_>> = side_by_side.collect();
        let rest = crowd.into_iter().zip(&stepped).filter(|(_, stepped)| stepped.is_none()).map(|(one, _)| one);
        let mut rest = Deformer::step_together(rest.collect(), dt).into_iter();
        stepped.iter_mut().filter(|stepped| stepped.is_none()).for_each(|place| *place = rest.next());
        stepped.into_iter().flatten().collect()
    }

    /// Those on one GPU together, the others one after another.
    fn step_together(mut crowd: Vec<(&mut Deformer, &Attributes)>, dt: f32) -> Vec<Result<StepReport, StepError>> {
        let ready: Vec<_> = crowd.iter_mut().map(|(one, attributes)| one.ready(dt, attributes)).collect();
        let jobs = crowd.iter_mut().zip(&ready);
        let jobs = jobs.filter_map(|((one, attributes), ready)| Some(one.job(ready.as_ref().ok()?.as_ref()?, attributes)));
        let mut stepped = Engine::step_all(jobs.collect()).into_iter();
        let each = crowd.into_iter().zip(ready);
        each.map(|((one, attributes), ready)| match ready? {
            Some(taken) => one.stepped(stepped.next().unwrap_or(Ok(None)), taken, attributes),
            None => Ok(idle(dt)),
        })
        .collect()
    }

    /// Checks a step; returns what it takes.
    fn taken(&self, dt: f32, attributes: &Attributes) -> Result<Taken, StepError> {
        if !(dt >= MIN_TIME_STEP && dt.is_finite()) {
            return Err(StepError::TimeStep { dt });
        }
        attributes.validate(self.cloth.pinned.len())?;
        self.motion.check(&attributes.colliders)?;
        let thickness = self.contact_thickness(attributes)?;
        let load = Load::of(&self.cloth, &self.motion, attributes, dt, self.seen.as_ref(), thickness.is_some());
        let controller = self.controlled(dt, &load);
        let rate = self.rates.rate(&self.options, controller.count());
        let rate = thickness.map_or(rate, |thickness| rate.max(self.resolving_contact(thickness, load.led_speed)));
        let division = self.rates.divide(&self.cloth, &self.options, dt, rate)?;
        let levels = self.rates.levels(&self.cloth, &self.options, division.length, attributes);
        Ok(Taken { dt, load, controller, rate, division, levels })
    }

    /// Checks a step and brings the coefficients up to date; returns what it takes, or nothing if there is nothing to do.
    fn ready(&mut self, dt: f32, attributes: &Attributes) -> Result<Option<Taken>, StepError> {
        self.look_back()?;
        if dt == 0.0 {
            return attributes.validate(self.cloth.pinned.len()).map(|()| None);
        }
        let taken = self.taken(dt, attributes)?;
        if self.sleeps(attributes) {
            return Ok(None);
        }
        let (length, levels) = (taken.division.length, taken.levels);
        if self.coefficients.as_ref().is_none_or(|last| last.length != length || self.asked != levels) {
            self.hierarchy.build(&self.cloth, levels);
            self.coefficients = Some(Coefficients::new(&self.cloth, self.hierarchy.finest(levels), &self.options, length));
            self.asked = levels;
        }
        Ok(Some(taken))
    }

    /// What the engine is to do, and the engine.
    fn job<'a>(&'a mut self, taken: &Taken, attributes: &Attributes) -> (&'a mut Engine, Plan<'a>) {
        let observed = self.is_observed();
        let coefficients = self.coefficients.as_ref().expect("a step is made ready first");
        let (levels, substeps) = (&self.hierarchy.levels, taken.division.substeps);
        let plan =
            Plan::new(&self.cloth, levels, &self.options, coefficients, &self.motion, substeps, attributes, &mut self.buffers);
        let mut plan = if observed { plan.observed(&self.motion, taken.dt, attributes) } else { plan };
        self.meeting = self.watch.meet(&self.cloth, &self.motion, attributes, f64::from(taken.dt));
        self.bounds = self.meeting.0.bounds(&self.cloth, &self.rates, attributes, coefficients.length);
        self.watch.tell(&mut plan.params, self.bounds);
        (&mut self.engine, plan)
    }

    /// Notes what a step leaves to the next.
    fn stepped(
        &mut self,
        stepped: Result<Option<Statistics>, Failure>,
        taken: Taken,
        attributes: &Attributes,
    ) -> Result<StepReport, StepError> {
        let seen = stepped.map_err(|failure| self.failed(failure))?;
        let Taken { dt, rate, division: Division { substeps, .. }, .. } = taken;
        let used = self.coefficients.as_ref().map(|used| (used.levels.len() as u32, used.bending.limited));
        let (levels, limited) = used.unwrap_or_default();
        self.watch = self.meeting.0;
        self.motion.h = dt / substeps as f32;
        self.motion.colliders.clone_from(&attributes.colliders);
        self.motion.led(&self.cloth, attributes.pin_targets.as_deref(), dt);
        self.colliders.clone_from(&attributes.colliders);
        self.gravity = attributes.gravity;
        self.shown = false;
        let mut warnings = self.warnings(dt, substeps, limited, self.meeting.1);
        warnings.extend(self.contact_warnings(&taken, attributes));
        let stretch = self.judged(taken, seen.as_ref(), &mut warnings);
        self.watch_for_sleep(dt, attributes, seen.as_ref());
        let contacts = self.engine.contact().map_or(0, |contact| contact.tally.contacts);
        let in_a_sixtieth = (rate / FRAMES).ceil() as u32;
        Ok(StepReport { substeps, in_a_sixtieth, levels, contacts, stretch, asleep: false, warnings })
    }

    /// Back to frame 1: rest positions, no velocity. What follows replays bit for bit.
    pub fn reset(&mut self) {
        self.motion = Motion::after(&self.cloth, &self.cloth.rest, 0.0);
        self.watch = self.watch.placed(&self.cloth, &self.cloth.rest, &[]);
        (self.colliders, self.gravity) = (Vec::new(), Vec3::ZERO);
        self.forget();
        self.engine.set(&self.cloth.rest, &vec![Vec4::ZERO; self.cloth.rest.len()]);
        self.shown = false;
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

    /// The mesh's index of each vertex, in the order that the solver and `Deformer::position_buffer` have them in.
    #[must_use]
    pub fn vertex_order(&self) -> &[u32] {
        &self.cloth.order
    }
}

/// What a step of `dt` (s) comes to in which nothing is done: the cloth sleeps through it, or it takes no time.
fn idle(dt: f32) -> StepReport {
    StepReport { asleep: dt > 0.0, ..StepReport::default() }
}
