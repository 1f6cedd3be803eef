//! The commands of a step: its substeps, and its end.

use super::route::Besides;
use super::{EdgeSweep, GpuEngine, Route};
use crate::device::IN_BROWSER;
use crate::gpu::contact::GpuContact;
use crate::gpu::multigrid::Multigrid;
use crate::gpu::state::{PING_PONG, ping_pong};
use crate::gpu::submission::Submission;
use crate::step::plan::Plan;

impl GpuEngine {
    /// Encodes the commands of the step that was prepared. Returns the number of their dispatches.
    pub(super) fn encode(&self, submission: &mut Submission<'_>, plan: &Plan<'_>) -> usize {
        let before = submission.dispatches();
        if let (Route::SingleWorkgroup, Some(single)) = (self.way.route, &self.single_workgroup) {
            let pass = submission.group();
            self.forces.bind_substep(pass, 0);
            single.encode(pass);
        } else {
            self.encode_substeps(submission, plan, None);
            self.encode_commit(submission, plan);
        }
        submission.dispatches() - before
    }

    /// Encodes the substeps, each followed by contact of triangles if there is any; the plan beside it has the colliders.
    pub(super) fn encode_substeps(
        &self,
        submission: &mut Submission<'_>,
        plan: &Plan<'_>,
        contact: Option<(&GpuContact, &Plan<'_>)>,
    ) {
        let forced = self.way.forced(plan);
        for substep in 0..plan.substeps.len() {
            let group = ping_pong(substep);
            let pass = submission.group();
            self.forces.bind_substep(pass, substep);
            if self.way.predicted {
                self.forces.encode(pass, &forced, PING_PONG[group][0]);
            }
            let multigrid = self.multigrid(plan);
            if let Some(multigrid) = multigrid {
                if !self.forces.averages(&forced) {
                    multigrid.encode_averages(pass, &forced, group);
                }
                if self.way.besides != Some(Besides::Correcting) {
                    multigrid.encode(pass, plan);
                }
            }
            match &self.sweep {
                EdgeSweep::Tiled(tiled) => self.tiled(tiled).encode(pass, group, self.way.predicted),
                EdgeSweep::PerColor(per_color) => {
                    multigrid.into_iter().for_each(|multigrid| multigrid.encode_correct(pass, plan));
                    per_color.encode(pass, plan, group);
                }
            }
            if let (Some((contact, contact_plan)), false) = (contact, IN_BROWSER) {
                contact.encode(pass, contact_plan, substep, group);
            }
        }
    }

    /// Encodes the end of a step.
    pub(super) fn encode_commit(&self, submission: &mut Submission<'_>, plan: &Plan<'_>) {
        let last = plan.substeps.len() - 1;
        let pass = submission.pass();
        self.forces.bind_substep(pass, last);
        self.commit.encode(pass, PING_PONG[ping_pong(last)][1], plan.cloth, self.is_checked(plan));
    }

    /// Encodes the statistics of the step, if they are wanted. Returns the number of their dispatches.
    pub(super) fn encode_statistics(&self, submission: &mut Submission<'_>) -> usize {
        let before = submission.dispatches();
        if let Some(counter) = self.counter.as_ref().filter(|_| self.counts) {
            let pass = submission.pass();
            self.forces.bind_substep(pass, 0);
            counter.encode(pass);
        }
        submission.dispatches() - before
    }

    /// Encodes copies of what the CPU wants to know of the step.
    pub(super) fn encode_copies(&mut self, encoder: &mut wgpu::CommandEncoder) {
        self.report.copy_if_due(encoder, &self.commit.found);
        if let Some(counter) = self.counter.as_mut().filter(|_| self.counts) {
            counter.copy(&self.gpu, encoder);
        }
    }

    /// Asks for the copies that this submission, the last one, contains.
    pub(super) fn ask_for_copies(&mut self, submission: &wgpu::SubmissionIndex) {
        self.report.ask_if_copied(submission);
        self.counter.iter_mut().filter(|_| self.counts).for_each(|counter| counter.ask_if_copied(submission));
    }

    /// The levels, if the step uses any.
    pub(super) fn multigrid(&self, plan: &Plan<'_>) -> Option<&Multigrid> {
        self.multigrid.as_ref().filter(|_| plan.params.levels > 0)
    }

    /// Whether the last substep checks the step's result.
    pub(super) fn is_checked(&self, plan: &Plan<'_>) -> bool {
        plan.params.checks != 0 && matches!(self.sweep, EdgeSweep::Tiled(_))
    }
}
