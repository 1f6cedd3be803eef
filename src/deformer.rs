//! The deformer: a cloth, and one step of it from top to bottom. `forecast.rs` predicts a step before it is taken, and
//! `state.rs` reads and sets the state in the caller's vertex order.

#[cfg(feature = "bench")]
mod bench;
mod buckling;
mod change;
mod contact;
mod decision;
mod errors;
mod forecast;
mod imperfection;
mod measure;
mod quality;
mod rejection;
mod sleep;
mod snapshot;
mod state;
mod untangle;
mod warp;

pub use forecast::Forecast;
pub use measure::Measure;
use sleep::Stillness;
pub use snapshot::Snapshot;
pub use untangle::Untangled;

use std::collections::VecDeque;
use std::mem;

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use web_time::Instant;

use crate::attributes::Attributes;
use crate::backend::{Engine, Stepped};
use crate::deformer::buckling::Looks;
use crate::deformer::decision::{Expectation, StepDecision, check_time_step};
use crate::deformer::imperfection::FlatStart;
use crate::error::{BuildError, StepError};
use crate::kernels::statistics::Statistics;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::multigrid::hierarchy::Hierarchy;
use crate::options::{Backend, Options, Quality, StepReport};
use crate::step::coefficients::Coefficients;
use crate::step::controller::Controller;
use crate::step::motion::{Ambient, Motion};
use crate::step::pace::Pace;
use crate::step::plan::{Plan, PlanBuffers, StepInputs};
use crate::step::substep_count::{Rates, SIXTIETHS};
use crate::step::watch::{Bounds, Watch};
use crate::threads;

/// Cloths of up to this many vertices are stepped on a single thread each in [`Deformer::step_all`]: more threads would
/// not halve their time.
const SMALL: usize = 4096;

/// What the next step depends on, besides what the engine has of the motion.
#[derive(Debug, Clone, Default)]
struct State {
    motion: Motion,
    /// What chooses the substeps, and the steps whose statistics have not arrived yet.
    controller: Controller,
    awaiting_statistics: VecDeque<Expectation>,
    /// The latest statistics.
    seen: Option<Statistics>,
    /// Time that substeps take, for [`Quality::Budget`].
    pace: Pace,
    still: Stillness,
    looks: Looks,
    /// What the motion is checked against, and the bounds of the last step.
    watch: Watch,
    bounds: Bounds,
    /// Gravity of the last step (m/s²), for the potential energy.
    gravity: Vec3,
}

/// A cloth in motion.
pub struct Deformer {
    cloth: Cloth,
    options: Options,
    rates: Rates,
    engine: Engine,
    /// The coarse levels, built when a step first needs them, and the number of levels that the last step asked for.
    hierarchy: Hierarchy,
    levels_asked: usize,
    /// Coefficients for the last length of substep.
    coefficients: Option<Coefficients>,
    state: State,
    buffers: PlanBuffers,
    /// Positions and velocities last returned to the caller, in the mesh's order.
    positions: Vec<Vec3>,
    velocities: Vec<Vec3>,
    /// Positions last requested, in the mesh's order, and whether they have arrived and were not taken yet.
    requested: Vec<Vec3>,
    has_arrived: bool,
    /// `positions` in local coordinates, which are more precise far from the origin.
    local: Vec<Vec4>,
    /// The placed state that the next step begins from, if a part of it is flat.
    flat_start: Option<FlatStart>,
    /// The displacements before crushed cloth was given a kick, during a step that begins with one.
    before_kick: Option<Vec<Vec4>>,
    /// Whether `positions`, `velocities` and `local` are those of the current state.
    is_current: bool,
}

impl std::fmt::Debug for Deformer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (vertices, edges) = (self.cloth.rest.len(), self.cloth.links.len());
        write!(f, "Deformer({vertices} vertices, {edges} edges, {:?}, {:?})", self.options.method, self.backend())
    }
}

impl Deformer {
    /// Builds the cloth in its initial state: the mesh at rest, without velocity.
    ///
    /// # Errors
    /// If the mesh or an option is invalid, or there is no GPU for the requested backend.
    pub fn new(mesh: &Mesh, options: Options) -> Result<Deformer, BuildError> {
        let cloth = Cloth::new(mesh, &options)?;
        let rates = Rates::new(&cloth, &options);
        let engine = Engine::new(&cloth, &options)?;
        engine.check(options.quality)?;
        let motion = Motion::placed(&cloth, &cloth.rest, &[]);
        let watch = Watch::new(&cloth, &options);
        Ok(Deformer {
            rates,
            engine,
            hierarchy: Hierarchy::default(),
            levels_asked: 0,
            coefficients: None,
            state: State { motion, watch, ..State::default() },
            buffers: PlanBuffers::default(),
            positions: mesh.positions.clone(),
            velocities: vec![Vec3::ZERO; mesh.positions.len()],
            requested: Vec::new(),
            has_arrived: false,
            local: cloth.rest.clone(),
            flat_start: FlatStart::at_rest(&cloth),
            before_kick: None,
            is_current: true,
            cloth,
            options,
        })
    }

    /// Advances the cloth by `dt` (s). A step of 0 s only checks the attributes; the next step continues from where the
    /// motion was.
    ///
    /// Before the first step from a state that was placed, exactly flat parts of the cloth, and straight threads, are moved out of their
    /// plane or line if gravity acts along it: by up to a millionth of their size, or by some roundings of their coordinates if that is
    /// more. Otherwise they could not fold, and pins that close on each other would crush them. Likewise cloth that lies flat on a plane or
    /// a box, or floats without gravity, and is pushed together by pins or colliders gets a kick of some thousandths of an edge out of its
    /// plane, from which it wrinkles. On a GPU that takes statistics, which [`Quality::Substeps`] does without unless [`Options::sleep`]
    /// needs them.
    ///
    /// On the CPU the threads of the current rayon pool share the work, and a thread that waits for another may run any
    /// other task of that pool in the meantime, as always in rayon. Do not hold a lock across a step that another task
    /// of the same pool also takes: the step may run that task, which then waits for the lock, and thus for the step,
    /// forever. If a lock must be held, run the steps in a pool of their own and enter it from a thread outside any
    /// other pool: `pool.install(|| cloth.step(dt, &attributes))`.
    ///
    /// # Errors
    /// If `dt` is neither 0 nor at least 1e-9 s, an attribute is out of its range, more substeps than 65,536 would be needed, there
    /// are too many pairs in contact, the GPU failed, or the motion became unstable ([`StepError::Unstable`]); unless the GPU was
    /// lost, the state is then unchanged. On the GPU an instability is reported by the next read of the state, or by one of the next sixteen
    /// steps. The step that reports it is not taken, the steps since the unstable one are lost, and the state is that of the
    /// last good step.
    pub fn step(&mut self, dt: f32, attributes: &Attributes) -> Result<StepReport, StepError> {
        self.step_on(dt, attributes, false)
    }

    /// Takes a step, on this thread alone if `alone`, otherwise on as many threads as pay off.
    fn step_on(&mut self, dt: f32, attributes: &Attributes, alone: bool) -> Result<StepReport, StepError> {
        let length = self.coefficients.as_ref().map(|last| last.length);
        let Some(decision) = self.prepare(dt, attributes)? else { return Ok(idle(dt)) };
        // Only a budget needs a clock, which not every machine has.
        let counts = self.state.pace.begin(dt, length.is_some_and(|length| length != decision.expected.length));
        let is_timed = counts && !alone && matches!(self.options.quality, Quality::Budget(_));
        let start = is_timed.then(Instant::now);
        let (engine, plan) = self.plan(&decision, attributes);
        let stepped = engine.step(&Plan { alone, ..plan });
        if let (Some(start), Ok(_)) = (start, &stepped) {
            self.state.pace.note(start.elapsed().as_secs_f64(), decision.substeps);
        }
        self.accept(stepped, decision, attributes, alone)
    }

    /// Advances several cloths by `dt` (s), each with its own attributes:
    /// `step_all(crowd.iter_mut().map(|one| (one, &all)), dt)`.
    ///
    /// Cloths on the same GPU are submitted together: on a large GPU that a small cloth leaves mostly idle, many cloths
    /// take little longer than one. On the CPU small cloths are stepped in parallel, one thread each, if there are at
    /// least as many as threads in the current rayon pool. All others are stepped one after another, each on as many
    /// threads as pay off. On the CPU the result is bit for bit that of [`Deformer::step`]; on a GPU a cloth in a crowd
    /// may take another code path than by itself, and then differs by rounding.
    ///
    /// # Errors
    /// As [`Deformer::step`], for each cloth by itself; but if a GPU fails or refuses something to one cloth, all on it return that
    /// error. Where it was a limit, the others are unharmed and can be stepped again.
    pub fn step_all<'a>(
        crowd: impl IntoIterator<Item = (&'a mut Deformer, &'a Attributes)>,
        dt: f32,
    ) -> Vec<Result<StepReport, StepError>> {
        let mut crowd: Vec<_> = crowd.into_iter().collect();
        let is_small = |one: &Deformer| matches!(one.engine, Engine::Cpu(_)) && one.cloth.rest.len() <= SMALL;
        let enough = threads().max(2);
        // Stops counting as soon as there are enough: looking at each of a thousand cloths fetches it from memory.
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

    /// Steps cloths on the same GPU together and the others one after another.
    fn step_together(mut crowd: Vec<(&mut Deformer, &Attributes)>, dt: f32) -> Vec<Result<StepReport, StepError>> {
        let prepared: Vec<_> = crowd.iter_mut().map(|(one, attributes)| one.prepare(dt, attributes)).collect();
        let plans = crowd.iter_mut().zip(&prepared);
        let plans =
            plans.filter_map(|((one, attributes), prepared)| Some(one.plan(prepared.as_ref().ok()?.as_ref()?, attributes)));
        let mut stepped = Engine::step_all(plans.collect()).into_iter();
        let each = crowd.into_iter().zip(prepared);
        each.map(|((one, attributes), prepared)| match prepared? {
            Some(decision) => one.accept(stepped.next().unwrap_or(Ok(None)), decision, attributes, false),
            None => Ok(idle(dt)),
        })
        .collect()
    }

    /// Checks a step and updates the coefficients. Returns `None` if there is nothing to do.
    fn prepare(&mut self, dt: f32, attributes: &Attributes) -> Result<Option<StepDecision>, StepError> {
        self.check_late_failure()?;
        if dt == 0.0 {
            return self.check(attributes).map(|_| None);
        }
        // The attributes under which a cloth sleeps were valid in the last step, and a step that is slept through needs no substeps.
        if self.sleeps(attributes) {
            return check_time_step(dt).map(|()| None);
        }
        let mut decision = self.decide(dt, attributes)?;
        self.make_imperfect(attributes.gravity);
        decision.looks = self.let_buckle(attributes)?;
        self.set_coefficients(&decision);
        Ok(Some(decision))
    }

    /// Computes the coefficients of a step, unless they are those of the last.
    fn set_coefficients(&mut self, decision: &StepDecision) {
        let (length, levels) = (decision.expected.length, decision.levels as usize);
        if self.coefficients.as_ref().is_none_or(|last| last.length != length || self.levels_asked != levels) {
            self.hierarchy.build(&self.cloth, levels);
            self.coefficients = Some(Coefficients::new(&self.cloth, self.hierarchy.finest(levels), &self.options, length));
            self.levels_asked = levels;
        }
    }

    /// The engine and the plan that it is to execute.
    fn plan<'a>(&'a mut self, decision: &StepDecision, attributes: &'a Attributes) -> (&'a mut Engine, Plan<'a>) {
        let coefficients = self.coefficients.as_ref().expect("a step is prepared first");
        let inputs = StepInputs {
            cloth: &self.cloth,
            levels: &self.hierarchy.levels,
            lacks_levels: decision.lacks_levels,
            options: &self.options,
            coefficients,
            motion: &self.state.motion,
            substeps: decision.substeps,
            attributes,
        };
        let plan = Plan { whereabouts: decision.fastest.whereabouts, ..Plan::new(&inputs, &mut self.buffers) };
        let mut plan = if decision.is_observed { plan.observed() } else { plan };
        self.state.watch.limit(&mut plan.params, decision.bounds);
        (&mut self.engine, plan)
    }

    /// Updates everything the next step depends on, and makes the report.
    fn finish(&mut self, stepped: Stepped, decision: &StepDecision, attributes: &Attributes) -> Result<StepReport, StepError> {
        let before = mem::replace(&mut self.state.bounds, decision.bounds);
        let seen = stepped.map_err(|failure| {
            let error = self.failed(failure);
            self.state.bounds = before;
            self.make_flat();
            self.undo_kick();
            // Contact may have read the state and found that an earlier step failed.
            if self.backend() == Backend::Gpu && matches!(error, StepError::Unstable { .. }) {
                self.start_from_engine_state();
            }
            error
        })?;
        (self.flat_start, self.before_kick, self.state.looks) = (None, None, decision.looks);
        let &StepDecision { expected: Expectation { dt, length, .. }, substep_rate, substeps, fastest, .. } = decision;
        let used = self.coefficients.as_ref().map(|used| (used.levels.len() as u32, used.bending.limited));
        let (levels, limited) = used.unwrap_or_default();
        self.state.watch = self.state.watch.with_step(attributes, f64::from(dt), &fastest);
        let motion = &mut self.state.motion;
        (motion.dt, motion.h, motion.placed) = (dt, length.h, None);
        motion.ambient = Some(Ambient::of(attributes)).filter(Ambient::is_finite);
        motion.new_pins.clear();
        motion.colliders.clone_from(&attributes.colliders);
        motion.record_pins(&self.cloth, attributes.pin_targets.as_deref(), dt);
        self.state.gravity = attributes.gravity;
        self.is_current = false;
        let mut warnings = self.warnings(decision, limited);
        warnings.extend(self.contact_warnings(attributes));
        let stretch = self.evaluate(decision, seen.as_ref(), &mut warnings);
        self.watch_for_sleep(dt, attributes, seen.as_ref());
        let contacts = self.engine.contact().map_or(0, |tally| tally.contacts);
        let in_a_sixtieth = (substep_rate / SIXTIETHS).ceil() as u32;
        Ok(StepReport { substeps, in_a_sixtieth, levels, contacts, stretch, asleep: false, warnings })
    }

    /// Returns to the initial state: rest positions, no velocity. The same steps then give the same result bit for bit. Colliders
    /// are forgotten: those of the next step have no velocity unless [`Deformer::place_colliders`] is called again. A lost GPU is
    /// not reported here, but by the next step or read.
    pub fn reset(&mut self) {
        self.state.motion = Motion::placed(&self.cloth, &self.cloth.rest, &[]);
        self.state.watch = self.state.watch.placed(&self.cloth, &self.cloth.rest, &[]);
        self.state.gravity = Vec3::ZERO;
        self.forget();
        self.state.still = Stillness::default();
        self.engine.set(&self.cloth.rest, &vec![Vec4::ZERO; self.cloth.rest.len()]);
        self.flat_start = FlatStart::at_rest(&self.cloth);
        self.is_current = false;
    }

    /// The backend in use; never [`Backend::Auto`].
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

    /// The name of the GPU in use, if any.
    #[must_use]
    pub fn adapter(&self) -> Option<&str> {
        match &self.engine {
            Engine::Cpu(_) => None,
            #[cfg(feature = "gpu")]
            Engine::Hybrid(hybrid) => Some(hybrid.gpu.name()),
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => Some(gpu.gpu.name()),
        }
    }

    /// The options as they are now: those that the cloth was built with, and what was set since.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Number of colors of the edges. Edges of one color share no vertex; colors are visited one after another in a
    /// sweep.
    #[must_use]
    pub fn colors(&self) -> usize {
        self.cloth.colors.len()
    }

    /// The offset (m) subtracted from positions before they are computed with; 0 unless the mesh is far from the
    /// origin.
    #[must_use]
    pub fn origin(&self) -> Vec3 {
        self.cloth.origin
    }

    /// For each vertex in the solver's order, which is also that of `Deformer::position_buffer`: its index in the mesh.
    #[must_use]
    pub fn vertex_order(&self) -> &[u32] {
        &self.cloth.order
    }
}

/// The report of a step of `dt` (s) in which nothing is done, because the cloth sleeps or `dt` is 0.
fn idle(dt: f32) -> StepReport {
    StepReport { asleep: dt > 0.0, ..StepReport::default() }
}
