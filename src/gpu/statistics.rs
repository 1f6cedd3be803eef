//! Statistics of a state on the GPU: computed after a step, and read some steps later.

use std::collections::VecDeque;

use crate::device::fault::GpuFault;
use crate::device::reads::Mapping;
use crate::device::{Gpu, IN_BROWSER};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, ComputePass, Stage, WORKGROUP};
use crate::kernels::statistics::{Statistics, StrainGauge};

/// Most workgroups that compute statistics; each adds its result to that of the others.
const MAX_WORKGROUPS: usize = 256;

/// The stage that computes statistics, and the statistics that have not been returned yet.
pub(crate) struct Counter {
    stage: Stage,
    counted: wgpu::Buffer,
    /// Items to count.
    items: usize,
    /// Statistics of the last steps, the oldest first.
    pending: VecDeque<Pending>,
    /// Staging buffers that can be used again.
    free: Vec<wgpu::Buffer>,
    /// The one that what was encoded last copies the statistics to.
    copied: Option<wgpu::Buffer>,
}

enum Pending {
    UnderWay(Mapping),
    /// The statistics have arrived and are returned when it is their turn.
    Here(Box<Statistics>),
}

impl Counter {
    /// Number of steps by which statistics are late, unless the engine waits for each step anyway. As many steps may be queued
    /// before one waits for another. The number is constant, so that a motion can be repeated, except in a browser, which
    /// cannot wait.
    pub(crate) const LATE: usize = 3;

    pub(crate) fn new(gpu: &Gpu, forces: &Forces, gauges: &[StrainGauge]) -> Counter {
        let counted = gpu.buffer("statistics", size_of::<Statistics>() as u64);
        let items = gauges.len().max(forces.vertices());
        let gauges = gpu.filled("strain gauges", gauges);
        let state = &forces.states[0];
        let bound = [&gauges, &state.x, &state.p].map(Bind::Read).into_iter().chain([Bind::Write(&counted)]).collect();
        let stage = Stage::new(gpu, &forces.uniforms, shaders::STATISTICS.entry("count"), &[bound]);
        Counter { stage, counted, items, pending: VecDeque::new(), free: Vec::new(), copied: None }
    }

    /// Counts by another stage from now on.
    pub(crate) fn replace(&mut self, Counter { stage, counted, items, .. }: Counter) {
        (self.stage, self.counted, self.items) = (stage, counted, items);
    }

    /// Resets the statistics, ahead of what is submitted next.
    pub(crate) fn clear(&self, gpu: &Gpu) {
        gpu.write(&self.counted, 0, &[Statistics::default()]);
    }

    /// Encodes the statistics of the cloth's own state.
    pub(crate) fn encode(&self, pass: &mut ComputePass) {
        self.stage.dispatch_workgroups(pass, 0, &[], self.items.div_ceil(WORKGROUP).clamp(1, MAX_WORKGROUPS));
    }

    /// Copies the statistics after what was encoded.
    pub(crate) fn copy(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) {
        let size = self.counted.size();
        let staging = self.copied.take().or_else(|| self.free.pop()).unwrap_or_else(|| gpu.staging("statistics", size));
        encoder.copy_buffer_to_buffer(&self.counted, 0, &staging, 0, size);
        self.copied = Some(staging);
    }

    /// Requests the statistics, if this submission, the last one, copied them.
    pub(crate) fn ask_if_copied(&mut self, submission: &wgpu::SubmissionIndex) {
        let mapping = self.copied.take().map(|staging| Mapping::new(staging, Some(submission.clone())));
        self.pending.extend(mapping.map(Pending::UnderWay));
    }

    /// Returns the oldest statistics that have not been returned if they are from [`Counter::LATE`] steps before, or those of
    /// the last step if the engine `waits` for each; waits for them if necessary.
    pub(crate) fn received(&mut self, gpu: &Gpu, waits: bool) -> Result<Option<Statistics>, GpuFault> {
        if waits {
            // Those of steps that did not wait are not asked for any more.
            self.pending.drain(..self.pending.len().saturating_sub(1));
        }
        let late = if waits { 0 } else { Counter::LATE };
        if self.pending.len() <= late || IN_BROWSER && !self.is_here(gpu)? {
            return Ok(None);
        }
        let Some(oldest) = self.pending.pop_front() else { return Ok(None) };
        self.arrived(gpu, oldest).map(Some)
    }

    /// Whether the oldest statistics have arrived.
    fn is_here(&self, gpu: &Gpu) -> Result<bool, GpuFault> {
        gpu.poll(wgpu::PollType::Poll)?;
        Ok(self.pending.front().is_none_or(|pending| match pending {
            Pending::UnderWay(mapping) => mapping.is_told(),
            Pending::Here(_) => true,
        }))
    }

    /// Waits for statistics.
    fn arrived(&mut self, gpu: &Gpu, pending: Pending) -> Result<Statistics, GpuFault> {
        let mapping = match pending {
            Pending::UnderWay(mapping) => mapping,
            Pending::Here(seen) => return Ok(*seen),
        };
        mapping.wait(gpu)?;
        let seen =
            mapping.read(gpu, "the statistics", bytemuck::pod_read_unaligned)?.ok_or_else(|| gpu.unmapped("the statistics"))?;
        self.free.push(mapping.staging);
        Ok(seen)
    }

    /// Waits for the statistics of the last steps, and keeps them to be returned later.
    pub(crate) fn pending(&mut self, gpu: &Gpu) -> Result<Vec<Statistics>, GpuFault> {
        let pending = std::mem::take(&mut self.pending);
        let seen: Vec<Statistics> = pending.into_iter().map(|pending| self.arrived(gpu, pending)).collect::<Result<_, _>>()?;
        self.resume(&seen);
        Ok(seen)
    }

    /// Continues with statistics of the last steps that have not been returned.
    pub(crate) fn resume(&mut self, pending: &[Statistics]) {
        self.pending = pending.iter().map(|&seen| Pending::Here(Box::new(seen))).collect();
    }

    /// Drops the statistics of the last step.
    pub(crate) fn drop_last(&mut self) {
        self.pending.pop_back();
    }

    /// Drops the statistics that have not been returned.
    pub(crate) fn forget(&mut self) {
        self.pending.clear();
    }
}
