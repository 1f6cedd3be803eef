//! Collects the dispatches of a step: one pass and one submission, or as few submissions as possible.

use crate::device::Gpu;
use crate::gpu::stage::ComputePass;

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
    pass: ComputePass,
    /// Dispatches of the pass before the last group of [`Submission::group`], those of the group before, and those of earlier
    /// submissions.
    before: usize,
    last: usize,
    earlier: usize,
    /// Largest number of dispatches in this submission, and in the next one.
    most: [usize; 2],
}

impl<'a> Submission<'a> {
    pub(crate) fn new(gpu: &'a Gpu) -> Submission<'a> {
        Submission::after(gpu, |_| ())
    }

    /// For cloths of which none waits for another. A second submission would wait for the first, so there is one, up to
    /// [`LONGEST`] dispatches.
    pub(crate) fn of_crowd(gpu: &'a Gpu) -> Submission<'a> {
        Submission { most: [LONGEST; 2], ..Submission::new(gpu) }
    }

    /// With copies before the dispatches.
    fn after(gpu: &'a Gpu, copies: impl FnOnce(&mut wgpu::CommandEncoder)) -> Submission<'a> {
        let mut encoder = gpu.encoder();
        copies(&mut encoder);
        let pass = ComputePass::new(&mut encoder);
        Submission { gpu, encoder, pass, before: 0, last: 0, earlier: 0, most: [FIRST, LONGEST] }
    }

    /// For a step that is waited for, with copies before its dispatches.
    pub(crate) fn in_portions(gpu: &'a Gpu, copies: impl FnOnce(&mut wgpu::CommandEncoder)) -> Submission<'a> {
        Submission { most: [PORTIONS[0], 2 * PORTIONS[0]], ..Submission::after(gpu, copies) }
    }

    /// The pass, for a group of dispatches that must be in the same pass, about as many as those of the last group. Bindings
    /// may have to be set again.
    pub(crate) fn group(&mut self) -> &mut ComputePass {
        let [most, next] = self.most;
        if self.pass.dispatches > self.before {
            self.last = self.pass.dispatches - self.before;
        }
        if self.pass.dispatches > 0 && self.pass.dispatches + self.last > most {
            let after = if next < PORTIONS[1] { (2 * next).min(PORTIONS[1]) } else { next };
            let (last, earlier) = (self.last, self.dispatches());
            let next = Submission { last, earlier, most: [next, after], ..Submission::new(self.gpu) };
            std::mem::replace(self, next).submit();
        }
        self.before = self.pass.dispatches;
        &mut self.pass
    }

    /// The pass, for a few more dispatches.
    pub(crate) fn pass(&mut self) -> &mut ComputePass {
        &mut self.pass
    }

    /// Number of dispatches so far.
    pub(crate) fn dispatches(&self) -> usize {
        self.earlier + self.pass.dispatches
    }

    pub(crate) fn submit(self) {
        self.submit_with(|_| ());
    }

    /// Submits the pass, with copies after the dispatches.
    pub(crate) fn submit_with(self, copies: impl FnOnce(&mut wgpu::CommandEncoder)) -> wgpu::SubmissionIndex {
        let gpu = self.gpu;
        gpu.queue().submit([self.finish_with(copies)])
    }

    /// The commands of the pass, with copies after the dispatches, to be submitted later.
    pub(crate) fn finish_with(mut self, copies: impl FnOnce(&mut wgpu::CommandEncoder)) -> wgpu::CommandBuffer {
        drop(self.pass);
        copies(&mut self.encoder);
        self.encoder.finish()
    }
}

#[cfg(test)]
#[path = "../../tests/unit/gpu_submission.rs"]
mod tests;
