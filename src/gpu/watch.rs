//! The result of the stability check on the GPU: seven words that stay there until somebody reads them, and that are
//! read back with a delay where nobody does, so that no more than twice [`EVERY`] steps are under way.

use bytemuck::{Pod, Zeroable};

use crate::device::fault::GpuFault;
use crate::device::reads::Mapping;
use crate::device::{Gpu, IN_BROWSER};
use crate::error::failure::{Defect, Failure};
use crate::gpu::stage::NONE;

/// Marks an edge's place as one in the table of a single workgroup, or of tiles.
pub(crate) const IN_TABLE: u32 = 1 << 31;
pub(crate) const IN_TILES: u32 = 1 << 30;
/// Number of steps after which the words are requested again: often enough, at a negligible cost per step.
const EVERY: u32 = 8;

/// What the watch found out of bounds: `Defects` of `stages/watch.wgsl`, which documents the fields.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Defects {
    pub lost: u32,
    pub long: u32,
    pub fast: u32,
    pub energy: u32,
    pub hot: u32,
    pub stopped: u32,
    pub steps: u32,
}

impl Defects {
    /// The state before the first step.
    pub(crate) const NOTHING: Defects = Defects { lost: NONE, long: NONE, fast: NONE, energy: 0, hot: 0, stopped: 0, steps: 0 };

    /// The failure that the words report, if any; `edge` converts a marked place in a table to the cloth's edge.
    pub(crate) fn verdict(&self, edge: impl Fn(u32) -> usize) -> Result<(), Failure> {
        let Defects { lost, long, fast, hot, steps, .. } = *self;
        let cause = match (lost, hot, long) {
            (NONE, 0, NONE) => return Ok(()),
            (NONE, 0, place) => Defect::Edge(edge(place)),
            (NONE, ..) => Defect::Energy(if fast == NONE { 0 } else { fast as usize }),
            (vertex, ..) => Defect::Lost(vertex as usize),
        };
        Err(Failure::Unstable { cause, step: steps.saturating_add(1) })
    }
}

/// Reads the words back while steps continue.
pub(crate) struct Report {
    staging: wgpu::Buffer,
    asked: Option<Mapping>,
    /// Steps since the last request.
    steps: u32,
    /// Whether the last submission copied the words.
    is_copied: bool,
    /// Whether what was asked for is of a state that was replaced meanwhile.
    is_stale: bool,
}

impl Report {
    pub(crate) fn new(gpu: &Gpu) -> Report {
        let staging = gpu.staging("found", size_of::<Defects>() as u64);
        Report { staging, asked: None, steps: 0, is_copied: false, is_stale: false }
    }

    /// Counts a step, and copies the words after what was encoded if they are due.
    pub(crate) fn copy_if_due(&mut self, encoder: &mut wgpu::CommandEncoder, found: &wgpu::Buffer) {
        self.steps += 1;
        self.is_copied = self.steps >= EVERY && self.asked.is_none();
        if self.is_copied {
            encoder.copy_buffer_to_buffer(found, 0, &self.staging, 0, self.staging.size());
        }
    }

    /// Requests the words, if this submission, the last one, copied them.
    pub(crate) fn ask_if_copied(&mut self, submission: &wgpu::SubmissionIndex) {
        if std::mem::take(&mut self.is_copied) {
            self.steps = 0;
            self.asked = Some(Mapping::new(self.staging.clone(), Some(submission.clone())));
        }
    }

    /// Ignores the words that are under way when they arrive. Until then their buffer is in use.
    pub(crate) fn forget(&mut self) {
        self.is_stale = self.asked.is_some();
    }

    /// The words, once, if they have arrived; waits for them if they are due again. A lost device does not send them any more.
    pub(crate) fn arrived(&mut self, gpu: &Gpu) -> Result<Option<Defects>, GpuFault> {
        let Some(asked) = &self.asked else { return Ok(None) };
        if !IN_BROWSER && self.steps >= EVERY && !asked.is_told() {
            asked.wait(gpu)?;
        }
        let found = asked.read(gpu, "what steps found", bytemuck::pod_read_unaligned)?;
        self.asked.take_if(|_| found.is_some());
        Ok(found.filter(|_| !std::mem::take(&mut self.is_stale)))
    }
}

#[cfg(test)]
#[path = "../../tests/unit/gpu_watch.rs"]
mod tests;
