//! A step with contact of the cloth with itself.

use super::GpuEngine;
use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::error::failure::Failure;
use crate::gpu::contact::GpuContact;
use crate::gpu::submission::Submission;
use crate::kernels::params::Params;
use crate::model::cloth::Cloth;
use crate::options::Contact;
use crate::step::plan::Plan;

impl GpuEngine {
    /// Adds contact of the cloth with itself to the engine, if there are options for it.
    pub(crate) fn with_contact(mut self, cloth: &Cloth, contact: Option<Contact>) -> Result<GpuEngine, GpuFault> {
        let gpu = self.gpu.clone();
        let made = gpu.checked(|| Ok(contact.and_then(|contact| GpuContact::new(&gpu, cloth, contact))));
        self.contact = made?.map(Box::new);
        Ok(self)
    }

    /// Does one step, and waits for it. If the first attempt did not suffice, the step is rolled back and repeated.
    /// Contact resolves the colliders too, so the sweep ignores them.
    pub(super) fn step_with_contact(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        let gpu = self.gpu.clone();
        if self.contact.as_ref().is_some_and(|contact| contact.must_look(plan)) {
            let mut x = Vec::new();
            self.read(|at, _| x.extend_from_slice(at))?;
            self.contact.iter_mut().for_each(|contact| contact.look(&x));
        }
        let params = Params { bodies: 0, ..plan.params };
        let swept = Plan { bodies: &[], bodies_and_anchors: plan.anchors, params, ..*plan };
        let stepped = gpu.checked(|| {
            self.prepare(&swept, false);
            Gpu::refused()?;
            self.contact.iter_mut().for_each(|contact| contact.begin(&gpu, plan.substeps.len()));
            while let Some(contact) = &mut self.contact {
                contact.prepare(&gpu, plan, &self.forces);
                Gpu::refused()?;
                let mut submission = Submission::in_portions(&gpu);
                self.encode_substeps(&mut submission, &swept, Some(plan));
                let Some(contact) = &mut self.contact else { break };
                submission.submit_with(|encoder| contact.copy(encoder));
                match contact.judge(&gpu)? {
                    Ok(true) => {}
                    Ok(false) => break,
                    Err(pairs) => return Ok(Some(Failure::Crowded(pairs))),
                }
            }
            let mut submission = Submission::new(&gpu);
            self.encode_commit(&mut submission, &swept);
            let due = self.report.is_due();
            submission.submit_with(|encoder| self.report.copy(encoder, &self.commit.found, due));
            self.report.ask(due);
            Ok(None)
        });
        stepped.map_err(|fault| self.break_off(fault))?.map_or(Ok(()), Err)
    }

    /// Sets the room of the list of pairs, so that tests can have little.
    #[cfg_attr(not(feature = "bench"), expect(dead_code, reason = "the tests ask"))]
    pub(crate) fn contact_room(&mut self, pairs: usize) -> Result<(), GpuFault> {
        let GpuEngine { gpu, contact, .. } = self;
        gpu.checked(|| {
            contact.iter_mut().for_each(|contact| contact.make_room(gpu, pairs));
            Ok(())
        })
    }
}
