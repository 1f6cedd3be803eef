//! A step with contact of the cloth with itself or with mesh colliders.

use std::sync::Arc;

use super::GpuEngine;
use crate::contact::{ContactPast, Replaced};
use crate::device::fault::GpuFault;
use crate::device::{Gpu, IN_BROWSER};
use crate::error::failure::Failure;
use crate::gpu::contact::encode::COMPARERS;
use crate::gpu::contact::{GpuContact, Judgment};
use crate::gpu::state::{PING_PONG, ping_pong};
use crate::gpu::statistics::Counter;
use crate::gpu::submission::Submission;
use crate::kernels::params::Params;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::Contact;
use crate::step::plan::Plan;

impl GpuEngine {
    /// Adds contact of the cloth with itself to the engine, if there are options for it. There is none in a browser, which cannot
    /// wait for the GPU; a constant says so, and the compiler leaves the code out.
    pub(crate) fn with_contact(mut self, cloth: &Cloth, contact: Option<Contact>) -> Result<GpuEngine, GpuFault> {
        if !IN_BROWSER {
            self.prepare_contact(cloth, contact, [].iter())?;
        }
        Ok(self)
    }

    /// Creates the data of contact for these options and mesh colliders unless they exist. Returns those of before, if
    /// they were replaced.
    pub(super) fn prepare_contact<'a>(
        &mut self,
        cloth: &Cloth,
        contact: Option<Contact>,
        meshes: impl ExactSizeIterator<Item = &'a Arc<Mesh>> + Clone,
    ) -> Result<Option<Replaced<GpuContact>>, GpuFault> {
        let is_wanted = contact.is_some() || meshes.len() > 0;
        let is_there = self.contact.as_ref().map_or(!is_wanted, |there| is_wanted && there.on_cpu.bodies.are_of(meshes.clone()));
        if is_there {
            return Ok(None);
        }
        let gpu = self.gpu.clone();
        if is_wanted {
            gpu.has_threads(COMPARERS)?;
        }
        let make = || is_wanted.then(|| GpuContact::new(&gpu, cloth, contact, meshes.cloned().collect())).flatten();
        let made = gpu.checked(|| Ok(make()))?.map(Box::new);
        Ok(Some(Replaced(std::mem::replace(&mut self.contact, made))))
    }

    /// Takes a step, and goes back to the data of contact that it replaced if it fails.
    pub(super) fn step_with(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        let meshes = plan.meshes.iter().map(|body| &body.from);
        let replaced = self.prepare_contact(plan.cloth, plan.contact, meshes)?;
        let stepped = match self.contact.take() {
            None => self.step_alone(plan),
            Some(mut contact) => {
                let stepped = self.step_with_contact(&mut contact, plan);
                self.contact = Some(contact);
                stepped
            }
        };
        if let (Err(_), Some(Replaced(before))) = (&stepped, replaced) {
            self.contact = before;
        }
        // An earlier step has failed, and this is the contact of its end.
        if let (Err(Failure::Unstable { .. }), Some(contact)) = (&stepped, &mut self.contact) {
            contact.forget();
        }
        stepped
    }

    /// Continues contact from a saved state, if there is one. Returns false, and changes nothing, if the state cannot belong
    /// to this cloth.
    pub(super) fn resume_contact(
        &mut self,
        cloth: &Cloth,
        options: Option<Contact>,
        past: Option<&ContactPast>,
    ) -> Result<bool, GpuFault> {
        if IN_BROWSER {
            return Ok(past.is_none());
        }
        let gpu = self.gpu.clone();
        let may_have = |past: &ContactPast| {
            self.contact.as_ref().is_some_and(|contact| contact.on_cpu.bodies.are_numbered_for(past.numbered.iter()))
        };
        let replaced = match past {
            Some(past) if may_have(past) => None,
            Some(past) => {
                let made = gpu.checked(|| Ok(GpuContact::new(&gpu, cloth, options, past.numbered.clone())))?;
                Some(Replaced(std::mem::replace(&mut self.contact, made.map(Box::new))))
            }
            None => self.prepare_contact(cloth, options, [].iter())?,
        };
        let resumed = match (&mut self.contact, past) {
            (Some(contact), Some(past)) => gpu.checked(|| contact.resume(&gpu, past)),
            (contact, past) => Ok(contact.is_some() == past.is_some()),
        };
        match (&resumed, replaced) {
            (Ok(false) | Err(_), Some(Replaced(before))) => self.contact = before,
            // There was no memory for the list of pairs.
            (Err(fault), None) if !matches!(fault, GpuFault::Limit(_)) => self.broken = Some(fault.clone()),
            _ => {}
        }
        resumed
    }

    /// Undoes the last step, which was one with contact and good.
    pub(crate) fn roll_back(&mut self) {
        let GpuEngine { gpu, forces, commit, contact, .. } = self;
        contact.iter_mut().for_each(|contact| contact.undo(gpu, &forces.states[0], &commit.found));
    }

    /// Does one step, and waits for it. If the first attempt did not suffice, the step is rolled back and repeated.
    /// Contact resolves the colliders too, so the sweep ignores them.
    fn step_with_contact(&mut self, contact: &mut GpuContact, plan: &Plan<'_>) -> Result<(), Failure> {
        let gpu = self.gpu.clone();
        contact.note_meshes(plan);
        let mut searched = contact.on_cpu.must_search();
        if searched {
            self.find_crossings(contact, plan)?;
        }
        let swept = plan.without_bodies();
        let swept = Plan { params: Params { checks: 0, ..swept.params }, ..swept };
        let begun = gpu.checked(|| {
            self.prepare(&swept, false);
            Gpu::refused()?;
            contact.begin(&gpu, plan);
            Ok(())
        });
        begun.map_err(|fault| self.break_off(fault))?;
        loop {
            let attempted = gpu.checked(|| self.attempt(&gpu, contact, [plan, &swept], searched));
            match attempted.map_err(|fault| self.break_off(fault))? {
                Judgment::Good => break,
                Judgment::Again => {}
                Judgment::Search => {
                    self.find_crossings(contact, plan)?;
                    searched = true;
                }
                Judgment::Crowded(pairs) => return Err(Failure::Crowded(pairs)),
            }
        }
        let ignored = self.ignore_pinched(contact, plan);
        if ignored.is_err() && self.counts {
            // Nobody asks for those of a step that failed.
            self.counter.iter_mut().for_each(Counter::drop_last);
        }
        ignored
    }

    /// Searches for intersections at the start of the step.
    fn find_crossings(&mut self, contact: &mut GpuContact, plan: &Plan<'_>) -> Result<(), Failure> {
        let mut x = Vec::new();
        self.read(|at, _| x.extend_from_slice(at))?;
        if let Some(x) = contact.find_crossings(plan, x) {
            // If the step fails, the next one starts from there, too.
            self.gpu.write(&self.forces.states[0].x, 0, &x);
        }
        Ok(())
    }

    /// Searches for intersections at the end of the step where cloth may have been pinched.
    fn ignore_pinched(&mut self, contact: &mut GpuContact, plan: &Plan<'_>) -> Result<(), Failure> {
        if contact.on_cpu.is_pinched() {
            let mut x = Vec::new();
            self.read(|at, _| x.extend_from_slice(at))?;
            contact.ignore_pinched(plan, x);
        }
        Ok(())
    }

    /// Attempts the substeps of a step, waits for them, and commits the step if they are good. The sweep has a plan of its
    /// own. Unless intersections were `searched` for, the CPU meanwhile finds out whether they must be.
    fn attempt(
        &mut self,
        gpu: &Gpu,
        contact: &mut GpuContact,
        [plan, swept]: [&Plan<'_>; 2],
        searched: bool,
    ) -> Result<Judgment, GpuFault> {
        contact.prepare(gpu, plan, &self.forces);
        Gpu::refused()?;
        let mut submission =
            Submission::in_portions(gpu, |encoder| contact.save(encoder, &self.forces.states[0], &self.commit.found));
        self.encode_substeps(&mut submission, swept, Some((&*contact, plan)));
        self.dispatches = submission.dispatches();
        submission.submit_with(|encoder| contact.copy(encoder));
        if !searched && contact.on_cpu.kinematics_cross(plan) {
            contact.roll_back(gpu);
            return Ok(Judgment::Search);
        }
        // The device waits for the commit, so it is encoded before the judgment.
        let mut commit = Submission::new(gpu);
        self.encode_commit(&mut commit, swept);
        self.encode_statistics(&mut commit);
        self.dispatches += commit.dispatches();
        let commit = commit.finish_with(|encoder| self.encode_copies(encoder));
        let end = || {
            let mut x = Vec::new();
            let state = &self.forces.states[PING_PONG[ping_pong(plan.substeps.len() - 1)][1]];
            self.readback.read(gpu, state, &self.commit.found, |at, _| x.extend_from_slice(at))?;
            Ok(x)
        };
        let judgment = contact.judge(gpu, plan, end)?;
        if matches!(judgment, Judgment::Good) {
            let submission = gpu.queue().submit([commit]);
            self.ask_for_copies(&submission);
        }
        Ok(judgment)
    }
}
