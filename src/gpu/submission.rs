//! Collects the dispatches of a step: one pass and one submission, or as few submissions as possible.

use crate::device::Gpu;

/// Approximate number of dispatches per submission. Drivers reset a device that one submission occupies for seconds.
const LONGEST: usize = 16_384;
/// Dispatches in the first submission, with which the device begins while the others are encoded.
const FIRST: usize = 32;
/// Dispatches in the first submission of a step that is waited for, and most in the following ones, each of which has up
/// to twice as many as the one before: the device executes a dispatch more slowly than it is encoded, so it never waits
/// long.
const PORTIONS: [usize; 2] = [8, 96];

/// A compute pass, submitted when it is full or the step is encoded.
pub(crate) struct Submission<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    pass: wgpu::ComputePass<'static>,
    dispatches: usize,
    /// Largest number of dispatches in this submission, and in the next one.
    most: [usize; 2],
}

impl<'a> Submission<'a> {
    pub(crate) fn new(gpu: &'a Gpu) -> Submission<'a> {
        Submission::after(gpu, |_| ())
    }

    /// With copies before the dispatches.
    fn after(gpu: &'a Gpu, copies: impl FnOnce(&mut wgpu::CommandEncoder)) -> Submission<'a> {
        let mut encoder = gpu.encoder();
        copies(&mut encoder);
        let pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()).forget_lifetime();
        Submission { gpu, encoder, pass, dispatches: 0, most: [FIRST, LONGEST] }
    }

    /// For a step that is waited for, with copies before its dispatches.
    pub(crate) fn in_portions(gpu: &'a Gpu, copies: impl FnOnce(&mut wgpu::CommandEncoder)) -> Submission<'a> {
        Submission { most: [PORTIONS[0], 2 * PORTIONS[0]], ..Submission::after(gpu, copies) }
    }

    /// The pass, with room for some dispatches that must be in the same pass. Bindings may have to be set again.
    pub(crate) fn room_for(&mut self, dispatches: usize) -> &mut wgpu::ComputePass<'static> {
        let [most, next] = self.most;
        if self.dispatches > 0 && self.dispatches + dispatches > most {
            let after = if next < PORTIONS[1] { (2 * next).min(PORTIONS[1]) } else { next };
            let next = Submission { most: [next, after], ..Submission::new(self.gpu) };
            std::mem::replace(self, next).submit();
        }
        self.dispatches += dispatches;
        &mut self.pass
    }

    pub(crate) fn submit(self) {
        self.submit_with(|_| ());
    }

    /// Submits the pass, with copies after the dispatches.
    pub(crate) fn submit_with(self, copies: impl FnOnce(&mut wgpu::CommandEncoder)) {
        let gpu = self.gpu;
        gpu.queue().submit([self.finish_with(copies)]);
    }

    /// The commands of the pass, with copies after the dispatches, to be submitted later.
    pub(crate) fn finish_with(mut self, copies: impl FnOnce(&mut wgpu::CommandEncoder)) -> wgpu::CommandBuffer {
        drop(self.pass);
        copies(&mut self.encoder);
        self.encoder.finish()
    }
}
