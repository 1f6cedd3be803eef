//! What a step finds on the GPU: eight words that stay there until somebody looks, and that come back late where nobody does.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use bytemuck::{Pod, Zeroable};

use crate::device::Gpu;
use crate::failure::{Cause, Failure};
use crate::gpu_fault::GpuFault;

/// What a vertex or an edge is while there is none: `NONE` of `limits.wgsl`.
pub(crate) const NONE: u32 = u32::MAX;
/// Said beside an edge's place by `single_workgroup.wgsl`, where it is one in the tile's table.
pub(crate) const IN_TABLE: u32 = 1 << 31;
/// After so many steps the words are asked for once more: often enough, and next to nothing for each.
const EVERY: u32 = 8;

/// What has become of the words asked for.
const NOT_ASKED: u8 = 0;
const UNDER_WAY: u8 = 1;
const ARRIVED: u8 = 2;
const LOST: u8 = 3;

/// `Found` of `stages/watch.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Found {
    pub lost: u32,
    pub long: u32,
    pub fast: u32,
    pub energy: u32,
    pub hot: u32,
    pub stopped: u32,
    pub steps: u32,
    pub next: u32,
}

impl Found {
    /// Before the first step.
    pub(crate) const NOTHING: Found =
        Found { lost: NONE, long: NONE, fast: NONE, energy: 0, hot: 0, stopped: 0, steps: 0, next: 0 };

    /// The failure that it tells of, if any; `edge` turns what names an edge in the tile's table into its place.
    pub(crate) fn verdict(&self, edge: impl Fn(usize) -> usize) -> Result<(), Failure> {
        let Found { lost, long, fast, hot, steps, .. } = *self;
        let cause = match (lost, hot, long) {
            (NONE, 0, NONE) => return Ok(()),
            (NONE, 0, place) if place & IN_TABLE != 0 => Cause::Edge(edge((place ^ IN_TABLE) as usize)),
            (NONE, 0, place) => Cause::Edge(place as usize),
            (NONE, ..) => Cause::Energy(if fast == NONE { 0 } else { fast as usize }),
            (vertex, ..) => Cause::Lost(vertex as usize),
        };
        Err(Failure::Unstable { cause, step: steps.saturating_add(1) })
    }
}

/// The words on their way back while steps go on.
#[derive(Debug)]
pub(crate) struct Report {
    staging: wgpu::Buffer,
    /// Told by whoever polls the device, as every submit does.
    progress: Arc<AtomicU8>,
    /// Steps since they were last asked for.
    steps: u32,
}

impl Report {
    pub(crate) fn new(gpu: &Gpu) -> Report {
        let staging = gpu.staging("found", size_of::<Found>() as u64);
        Report { staging, progress: Arc::new(AtomicU8::new(NOT_ASKED)), steps: 0 }
    }

    /// Whether a step is to ask for them; counts it.
    pub(crate) fn is_due(&mut self) -> bool {
        self.steps += 1;
        self.steps >= EVERY && self.progress.load(Ordering::Acquire) == NOT_ASKED
    }

    /// Copies the words behind what was encoded, if that is due.
    pub(crate) fn copy(&self, encoder: &mut wgpu::CommandEncoder, found: &wgpu::Buffer, due: bool) {
        if !due {
            return;
        }
        encoder.copy_buffer_to_buffer(found, 0, &self.staging, 0, self.staging.size());
    }

    /// Asks for the words copied by what was submitted, if they were.
    pub(crate) fn ask(&mut self, due: bool) {
        if !due {
            return;
        }
        self.steps = 0;
        self.progress.store(UNDER_WAY, Ordering::Release);
        let told = Arc::clone(&self.progress);
        self.staging.map_async(wgpu::MapMode::Read, .., move |mapped| {
            told.store(if mapped.is_ok() { ARRIVED } else { LOST }, Ordering::Release);
        });
    }

    /// The words, once, if they have come. A device that was lost does not send them any more.
    pub(crate) fn arrived(&mut self, gpu: &Gpu) -> Result<Option<Found>, GpuFault> {
        match self.progress.load(Ordering::Acquire) {
            ARRIVED => {}
            LOST => return Err(gpu.unmapped("what steps found")),
            _ => return Ok(None),
        }
        let found = self.staging.get_mapped_range(..).ok().map(|bytes| bytemuck::pod_read_unaligned(&bytes));
        self.staging.unmap();
        self.progress.store(NOT_ASKED, Ordering::Release);
        Ok(found)
    }
}
