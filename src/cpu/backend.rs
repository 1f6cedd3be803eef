//! The CPU engine's state, and one step of it.

use std::ops::Range;
use std::sync::Arc;

use glam::Vec4;
use web_time::Instant;

use crate::contact::{Replaced, SubstepContext, TriangleContact, Workers};
use crate::cpu::correction::Correction;
use crate::cpu::integrate::Integrator;
use crate::cpu::packed::Packed;
use crate::cpu::schedule::{Part, Schedule};
use crate::cpu::statistics::Observed;
use crate::cpu::substep::{ExternalPrediction, Stepper};
use crate::cpu::sweep::Rule;
use crate::cpu::tasks::scheduler::On;
use crate::cpu::tasks::shared::{SharedArray, Task};
use crate::cpu::tasks::team::Team;
use crate::cpu::threads::ThreadChoice;
use crate::cpu::watch::VertexWatch;
use crate::error::failure::{Defect, Failure};
use crate::kernels::statistics::Statistics;
use crate::model::cloth::{Change, Cloth};
use crate::model::mesh::Mesh;
use crate::options::Contact;
use crate::past::Past;
use crate::simd::Width;
use crate::simd::aligned::AlignedVec;
use crate::step::plan::Plan;
use crate::threads;

/// The state of the cloth in memory, one value per vertex in the cloth's order, and all that is kept between its steps.
pub(crate) struct Cpu {
    /// Positions (m), w the inverse mass (1/kg).
    pub x: AlignedVec,
    /// Displacements (m) over the last substep; within a substep, over the substep being computed. The w component has
    /// no meaning.
    pub p: AlignedVec,
    /// `x` at the step's start, restored if the step fails.
    x_good: AlignedVec,
    /// `p` at the step's start.
    p_good: AlignedVec,
    /// Number of successful steps since the state was set, now and at the start of the last step.
    steps: u32,
    steps_good: u32,
    packed: Packed,
    /// The adaptive choice of the number of threads.
    choice: Option<ThreadChoice>,
    /// A fixed number of threads that overrides the choice.
    threads: Option<usize>,
    /// Contact of triangles (the cloth with itself and with mesh colliders), if the scene has any.
    pub contact: Option<Box<TriangleContact>>,
    /// What the last step found in its place and replaced, to go back to if the step fails; `None` if it kept it.
    replaced: Option<Replaced<TriangleContact>>,
    /// Run each pass as a parallel loop instead of through the task graph.
    #[cfg(feature = "bench")]
    pub loop_by_loop: bool,
}

impl Cpu {
    pub(crate) fn new(cloth: &Cloth) -> Cpu {
        let zero = AlignedVec::new(cloth.rest.len());
        let mut x = zero.clone();
        x.copy_from_slice(&cloth.rest);
        Cpu {
            x,
            p: zero.clone(),
            x_good: zero.clone(),
            p_good: zero,
            steps: 0,
            steps_good: 0,
            packed: Packed::new(Width::detected()),
            choice: None,
            threads: None,
            contact: None,
            replaced: None,
            #[cfg(feature = "bench")]
            loop_by_loop: false,
        }
    }

    /// Limits the SIMD width to `width`, as if the processor had no wider registers.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn narrow(&mut self, width: Width) {
        self.packed = Packed::new(width);
    }

    /// Fixes the number of threads (at most those of the pool) instead of choosing it adaptively.
    #[cfg(feature = "bench")]
    pub(crate) fn on_threads(&mut self, threads: usize) {
        self.threads = Some(threads.max(1));
    }

    /// Sets positions and displacements; what was learned about the motion is discarded.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.put(x, p);
        self.steps = 0;
        self.contact.iter_mut().for_each(|contact| contact.forget());
    }

    pub(crate) fn put(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.x.copy_from_slice(x);
        self.put_displacements(p);
    }

    pub(crate) fn put_displacements(&mut self, p: &[Vec4]) {
        self.p.copy_from_slice(p);
    }

    pub(crate) fn past(&self) -> Past {
        let contact = self.contact.as_deref().map(TriangleContact::past);
        Past { steps: self.steps, pending: Vec::new(), contact }
    }

    /// Resumes from a state and a recorded past. Returns false if this cloth cannot have such a past; positions and
    /// displacements are then unchanged.
    pub(crate) fn resume(&mut self, cloth: &Cloth, options: Option<Contact>, [x, p]: [&[Vec4]; 2], past: &Past) -> bool {
        if !past.pending.is_empty() {
            return false;
        }
        self.replaced = None;
        match &past.contact {
            None => _ = self.set_contact(None),
            Some(past) => {
                if !self.contact.as_ref().is_some_and(|contact| contact.bodies.are_numbered_for(past.numbered.iter())) {
                    self.make_contact(cloth, options, past.numbered.clone());
                }
                if !self.contact.as_mut().is_some_and(|contact| contact.resume(past)) {
                    self.put_back_contact();
                    return false;
                }
            }
        }
        self.put(x, p);
        self.steps = past.steps;
        true
    }

    /// Creates the contact data that a plan needs unless it exists, and puts aside what it does not need.
    fn prepare_contact(&mut self, plan: &Plan<'_>) {
        self.replaced = None;
        let meshes = plan.meshes.iter().map(|body| &body.from);
        match &self.contact {
            Some(_) if !plan.has_contact() => self.replace_contact(None),
            Some(contact) if contact.bodies.are_of(meshes.clone()) => {}
            _ if plan.has_contact() => self.make_contact(plan.cloth, plan.contact, meshes.cloned().collect()),
            _ => {}
        }
    }

    fn make_contact(&mut self, cloth: &Cloth, options: Option<Contact>, meshes: Vec<Arc<Mesh>>) {
        self.replace_contact(TriangleContact::new(cloth, options, meshes).map(Box::new));
    }

    fn replace_contact(&mut self, contact: Option<Box<TriangleContact>>) {
        let mut replaced = self.set_contact(contact);
        replaced.iter_mut().for_each(|contact| contact.save());
        self.replaced = Some(Replaced(replaced));
    }

    /// Goes back to the contact data that was replaced. Returns false if none was.
    fn put_back_contact(&mut self) -> bool {
        let Some(Replaced(contact)) = self.replaced.take() else { return false };
        self.set_contact(contact);
        true
    }

    /// Sets the contact data, extends the state by the vertices of its mesh colliders, and returns the data of before.
    fn set_contact(&mut self, contact: Option<Box<TriangleContact>>) -> Option<Box<TriangleContact>> {
        let vertices = contact.as_ref().map_or(0, |contact| contact.vertices());
        [&mut self.x, &mut self.p].into_iter().for_each(|state| state.make_room(vertices));
        std::mem::replace(&mut self.contact, contact)
    }

    pub(crate) fn lanes(&self) -> usize {
        self.packed.width.lanes()
    }

    /// Continues with changed parameters of the cloth. A change of stiffness needs nothing here: it changes
    /// `Length::changes`, so the coefficients are packed again for the next step.
    pub(crate) fn change(&mut self, change: Change, [x, p]: [&[Vec4]; 2]) {
        if change == Change::Stiffness {
            return;
        }
        self.put(x, p);
        self.packed.forget(change);
    }

    /// Runs one step. If `external` is given, another engine predicts the displacements. If the motion became
    /// unstable, the step is undone and the cause returned.
    pub(crate) fn step(&mut self, plan: &Plan<'_>, external: Option<&dyn ExternalPrediction>) -> Result<(), Failure> {
        self.steps_good = self.steps;
        let step = self.steps.saturating_add(1);
        let cause = self.run(plan, external);
        let too_many = self.contact.as_ref().map_or(0, |contact| contact.too_many);
        let failure = match (cause, too_many) {
            (None, 0) => {
                self.steps = step;
                return Ok(());
            }
            (Some(cause), 0) => Failure::Unstable { cause, step },
            (_, pairs) => Failure::Crowded(pairs),
        };
        self.roll_back();
        Err(failure)
    }

    /// Statistics of the state after a step, if the plan asks for them.
    pub(crate) fn statistics(&self, plan: &Plan<'_>) -> Option<Statistics> {
        let gauges = plan.gauges?;
        let alone = plan.alone || self.choice.as_ref().is_none_or(|choice| choice.threads() == 1);
        let (x, u, width) = (&self.x[..plan.cloth.used], &self.p[..plan.cloth.used], self.packed.width);
        Some(Observed { x, u, drift: plan.params.drift.into(), h: plan.params.h, width }.statistics(gauges, alone))
    }

    /// Restores the state at the start of the last step.
    pub(crate) fn roll_back(&mut self) {
        self.x.copy_from_slice(&self.x_good);
        self.p.copy_from_slice(&self.p_good);
        self.steps = self.steps_good;
        if !self.put_back_contact() {
            self.contact.iter_mut().for_each(|contact| contact.roll_back());
        }
    }

    /// Runs the substeps of a step and returns what is wrong with the resulting state, if anything.
    fn run(&mut self, plan: &Plan<'_>, external: Option<&dyn ExternalPrediction>) -> Option<Defect> {
        let pool = threads();
        self.prepare_contact(plan);
        if self.packed.pack(plan, external.is_some(), self.contact.is_some(), pool) {
            // Times measured for each number of threads no longer apply.
            self.choice = None;
        }
        let choice = self.choice.get_or_insert_with(|| ThreadChoice::new(plan.cloth.rest.len(), pool));
        let threads = self.threads.map_or(choice.threads(), |threads| threads.min(pool));
        let threads = if plan.alone { 1 } else { threads };
        let turns = plan.substeps.len() as u32 * plan.params.sweeps.max(1);
        // A pool of one thread leaves nothing to choose, and its platform (a browser) may have no clock.
        let start = (pool > 1 && !plan.alone).then(Instant::now);
        let cause = match self.contact.take() {
            None => self.turns(Part::Prologue, 0..turns, plan, external, On::Pool(threads)),
            Some(mut contact) => {
                // Contact shares its loops among the whole pool, whatever number of threads pays off for the rest.
                let team = if threads > 1 { pool } else { 1 };
                let cause = Team::gather(team, |team| self.substeps(&mut contact, plan, external, team, threads));
                self.contact = Some(contact);
                cause
            }
        };
        let note = |start: Instant| start.elapsed().as_secs_f64() / f64::from(turns);
        start.into_iter().zip(&mut self.choice).for_each(|(start, choice)| choice.note(note(start)));
        cause
    }

    /// Runs the substeps of a step one by one, resolving contact of triangles before each move.
    fn substeps(
        &mut self,
        contact: &mut TriangleContact,
        plan: &Plan<'_>,
        external: Option<&dyn ExternalPrediction>,
        team: &Team,
        threads: usize,
    ) -> Option<Defect> {
        let run = |count: usize, work: &(dyn Fn(usize) + Sync)| team.run(count, work);
        let (workers, on) = (Workers::new(team.threads(), &run), On::Team(team, threads));
        let sweeps = plan.params.sweeps.max(1);
        // Contact also handles the analytic colliders, so the move must not handle them again.
        let moves = plan.without_bodies();
        contact.begin(plan, self.x.room(), self.p.room());
        let mut cause = self.turns(Part::Prologue, 0..1, plan, external, on);
        for (index, substep) in plan.substeps.iter().enumerate() {
            let turns = index as u32 * sweeps..(index as u32 + 1) * sweeps;
            cause = cause.or(self.turns(Part::Substep, turns.clone(), plan, external, on));
            let context = SubstepContext { plan, substep, workers, width: self.packed.width };
            contact.resolve(context, self.x.room(), self.p.room());
            cause = cause.or(self.turns(Part::Move, turns.end - 1..turns.end, &moves, external, on));
        }
        contact.end(self.x.room(), self.p.room(), workers);
        cause
    }

    /// Runs a range of turns of a part of the step and returns what is wrong with the resulting state, if anything.
    fn turns(
        &mut self,
        part: Part,
        turns: Range<u32>,
        plan: &Plan<'_>,
        external: Option<&dyn ExternalPrediction>,
        on: On<'_>,
    ) -> Option<Defect> {
        let Cpu { x, p, x_good, p_good, packed, steps, .. } = self;
        let found = VertexWatch::nothing(&plan.params, x);
        let Packed { forces, coarse, edges, edges_back, tethers, schedules, partition, width, terms, .. } = packed;
        let schedule = &mut schedules[part as usize];
        let (x, u) = (SharedArray::new(x.room()), SharedArray::new(p.room()));
        let good = [x_good, p_good].map(|good| SharedArray::new(good.room()));
        let stepper = Stepper {
            plan,
            terms: terms.expect("packed"),
            partition: partition.as_ref().expect("packed"),
            edges: [edges, edges_back],
            tethers,
            forces: forces.share(plan, &x, &u, *width),
            correction: Correction::new(coarse, &x, &u, Rule::of_levels(plan), *width),
            integrator: Integrator { plan, x: &x, u: &u, good, found, width: *width },
            chunks: schedule.chunks.as_deref(),
            external,
            rule: Rule::of(plan.method),
            workers: on.threads(),
        };
        let Schedule { passes, graph, .. } = schedule;
        let (first, count) = (turns.start, turns.end - turns.start);
        let work = |task: &Task, turn: u32, pass: usize, index: usize| stepper.work(task, &passes[pass], first + turn, index);
        #[cfg(feature = "bench")]
        if self.loop_by_loop {
            graph.run_pass_by_pass(count, &work);
        } else {
            graph.run(count, on, &work);
        }
        #[cfg(not(feature = "bench"))]
        graph.run(count, on, &work);
        let found = stepper.integrator.found;
        found.verdict(plan.cloth, &plan.params, *steps, &self.x, &self.p)
    }
}
