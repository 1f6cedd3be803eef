//! Access to a cloth on the GPU between steps: its state (set, read, requested, restored), statistics, and what is drawn of it.

use std::sync::Arc;

use glam::Vec4;

use super::{EdgeSweep, GpuEngine};
use crate::device::IN_BROWSER;
use crate::device::fault::GpuFault;
use crate::error::failure::Failure;
use crate::gpu::bound_mesh::BoundMesh;
use crate::gpu::stage::SubmittedStage;
use crate::gpu::statistics::Counter;
use crate::gpu::surface::{Normals, Surface};
use crate::gpu::watch::{Defects, IN_TABLE, IN_TILES};
use crate::kernels::follow::BoundVertex;
use crate::kernels::statistics::Statistics;
use crate::model::cloth::Cloth;
use crate::options::Contact;
use crate::past::Past;

impl GpuEngine {
    /// Statistics that have arrived, after a step that computes any. After a step without, those of earlier steps are not returned any
    /// more.
    pub(crate) fn statistics(&mut self) -> Result<Option<Statistics>, Failure> {
        let GpuEngine { gpu, counter, counts, contact, .. } = self;
        let Some(counter) = counter else { return Ok(None) };
        if !*counts {
            counter.forget();
            return Ok(None);
        }
        gpu.checked(|| counter.received(gpu, contact.is_some())).map_err(Failure::Gpu)
    }

    /// Sets the state.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.put(x, p, 0);
        self.counter.iter_mut().for_each(Counter::forget);
        self.readback.forget();
        self.report.forget();
        self.contact.iter_mut().for_each(|contact| contact.forget());
    }

    /// Writes the state that `steps` steps led to.
    pub(crate) fn put(&self, x: &[Vec4], p: &[Vec4], steps: u32) {
        self.gpu.write(&self.forces.states[0].x, 0, x);
        self.put_displacements(p);
        self.commit.restart(&self.gpu, steps);
    }

    pub(crate) fn put_displacements(&self, p: &[Vec4]) {
        self.gpu.write(&self.forces.states[0].p, 0, p);
    }

    /// What the engine knows besides positions and displacements; waits for it.
    pub(crate) fn past(&mut self) -> Result<Past, Failure> {
        let GpuEngine { gpu, commit, counter, contact, .. } = self;
        gpu.checked(|| {
            let found = commit.read_found(gpu)?;
            let pending = counter.as_mut().map_or(Ok(Vec::new()), |counter| counter.pending(gpu))?;
            let contact = contact.as_ref().map(|contact| contact.past(gpu)).transpose()?;
            Ok(Past { steps: found.steps, pending, contact })
        })
        .map_err(Failure::Gpu)
    }

    /// Continues from a state and a past. Returns false and changes nothing if they cannot belong to this cloth.
    pub(crate) fn resume(
        &mut self,
        cloth: &Cloth,
        options: Option<Contact>,
        [x, p]: [&[Vec4]; 2],
        past: &Past,
    ) -> Result<bool, Failure> {
        self.check_whole()?;
        if past.pending.len() > Counter::LATE {
            return Ok(false);
        }
        let gpu = self.gpu.clone();
        if self.counter.is_none() && !past.pending.is_empty() {
            let counter = gpu.checked(|| Ok(Counter::new(&gpu, &self.forces, cloth.gauges())));
            self.counter = Some(counter?);
        }
        if !self.resume_contact(cloth, options, past.contact.as_ref())? {
            return Ok(false);
        }
        self.put(x, p, past.steps);
        self.readback.forget();
        self.report.forget();
        self.counter.iter_mut().for_each(|counter| counter.resume(&past.pending));
        Ok(true)
    }

    /// Waits for everything submitted.
    pub(crate) fn wait(&self) -> Result<(), Failure> {
        self.gpu.wait()?;
        if self.gpu.is_lost() { Err(Failure::Gpu(GpuFault::Lost)) } else { Ok(()) }
    }

    /// Waits for the GPU and passes its state to `read`. Then fails if the GPU had to return to the state before a
    /// failed step.
    pub(crate) fn read(&mut self, read: impl FnOnce(&[Vec4], &[Vec4])) -> Result<(), Failure> {
        let seen = self.readback.read(&self.gpu, &self.forces.states[0], &self.commit.found, read);
        let found = seen?;
        let good = self.verdict(found);
        if good.is_err() {
            self.go_on(found);
        }
        good
    }

    /// Goes on from the state before a failed step, which the GPU has kept.
    fn go_on(&mut self, found: Defects) {
        self.commit.restart(&self.gpu, found.steps);
        // What was requested reports the same failure, in terms of an engine that may be replaced meanwhile.
        self.readback.forget();
        self.report.forget();
        self.contact.iter_mut().for_each(|contact| contact.forget());
    }

    /// Fails if the words report a failure.
    fn verdict(&self, found: Defects) -> Result<(), Failure> {
        found.verdict(|place| match (place & IN_TABLE != 0, &self.single_workgroup, &self.sweep) {
            (true, Some(single), _) => single.tiles.edge((place ^ IN_TABLE) as usize),
            (false, _, EdgeSweep::Tiled(tiled)) if place & IN_TILES != 0 => tiled.tiles.edge((place ^ IN_TILES) as usize),
            _ => place as usize,
        })
    }

    /// Whether a step is now known to have failed. Never waits.
    pub(crate) fn has_failed_late(&mut self) -> Result<bool, Failure> {
        let Some(found) = self.report.arrived(&self.gpu)? else { return Ok(false) };
        let verdict = self.verdict_for_good(found);
        // Elsewhere the state is read next, which finds the same.
        if IN_BROWSER { verdict.map(|()| false) } else { Ok(verdict.is_err()) }
    }

    /// The same as `verdict`; in a browser, where the state cannot be read, it goes on after a failure.
    fn verdict_for_good(&mut self, found: Defects) -> Result<(), Failure> {
        let verdict = self.verdict(found);
        if IN_BROWSER && verdict.is_err() {
            self.go_on(found);
        }
        verdict
    }

    /// Requests the positions, in place of the previous request.
    pub(crate) fn request(&mut self) -> Result<(), Failure> {
        let x = &self.forces.states[0].x;
        self.readback.request(&self.gpu, x, &self.commit.found).map_err(Failure::Gpu)
    }

    /// Passes the requested positions to `read`, once, if they have arrived; returns whether they have.
    pub(crate) fn arrived(&mut self, read: impl FnOnce(&[Vec4])) -> Result<bool, Failure> {
        match self.readback.arrived(&self.gpu, read)? {
            Some(found) => self.verdict_for_good(found).map(|()| true),
            None => Ok(false),
        }
    }

    /// Submits the computation of the normals after the steps so far.
    pub(crate) fn surface(&self, cloth: &Cloth) -> Result<Surface, Failure> {
        // A lost device takes submissions as if nothing had happened.
        if self.gpu.is_lost() {
            return Err(Failure::Gpu(GpuFault::Lost));
        }
        let normals = self.gpu.checked(|| {
            let normals = self.normals(cloth);
            SubmittedStage::submit(&self.gpu, &[&normals.stage]);
            Ok(normals)
        })?;
        Ok(self.normals.get_or_init(|| normals).surface.clone())
    }

    /// The stage that computes normals. A new one is kept by the caller if nothing of it was refused.
    fn normals(&self, cloth: &Cloth) -> Arc<Normals> {
        let made = self.normals.get().cloned();
        made.unwrap_or_else(|| Arc::new(Normals::new(&self.gpu, cloth, &self.forces.states[0].x)))
    }

    /// A render mesh that follows the cloth, its vertices given.
    pub(crate) fn bind(&self, cloth: &Cloth, vertices: &[BoundVertex], has_normals: bool) -> Result<BoundMesh, GpuFault> {
        self.gpu.meets("the render mesh's vertices", size_of_val(vertices) as u64)?;
        let bound = self.gpu.checked(|| Ok(BoundMesh::new(&self.gpu, self.normals(cloth), vertices, has_normals)))?;
        self.normals.get_or_init(|| Arc::clone(&bound.normals));
        Ok(bound)
    }
}
