//! A step's dispatches on their way to the device, and what they come to.

use super::device::Gpu;

/// Dispatches in one submit, about: a driver takes the device away from work that holds it for seconds.
const LONGEST_SUBMIT: usize = 16_384;

/// Dispatches on their way to the device: one pass and one submit, or as few as it bears.
pub(super) struct Work<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    pass: wgpu::ComputePass<'static>,
    dispatches: usize,
}

impl<'a> Work<'a> {
    pub(super) fn new(gpu: &'a Gpu) -> Work<'a> {
        let mut encoder = gpu.encoder();
        let pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()).forget_lifetime();
        Work { gpu, encoder, pass, dispatches: 0 }
    }

    /// The pass, with room for some dispatches that belong together. What was bound may have to be bound again.
    pub(super) fn room_for(&mut self, dispatches: usize) -> &mut wgpu::ComputePass<'static> {
        if self.dispatches > 0 && self.dispatches + dispatches > LONGEST_SUBMIT {
            std::mem::replace(self, Work::new(self.gpu)).submit();
        }
        self.dispatches += dispatches;
        &mut self.pass
    }

    pub(super) fn submit(self) {
        drop(self.pass);
        self.gpu.queue.submit([self.encoder.finish()]);
    }
}

/// What a step asks of a GPU, counted: for a roofline beside measured times.
#[doc(hidden)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GpuWork {
    /// Dispatches that each wait for the one before.
    pub dispatches: usize,
    /// Bytes read and written if each dispatch reads what it needs once.
    pub bytes: usize,
    /// Colours that each wait for the one before, inside of dispatches.
    pub rounds: usize,
    /// Edges corrected in workgroup memory, those of halos in every patch that has them.
    pub edges: usize,
}
