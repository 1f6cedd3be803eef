//! Hooks for the benches and tests of this repository; not part of the crate's interface.

use super::Deformer;
#[cfg(feature = "gpu")]
use crate::backend::Engine;
use crate::contact::Tally;
use crate::simd::Width;
#[cfg(feature = "gpu")]
use crate::{attributes::Attributes, error::StepError, error::failure::Failure, gpu::GpuEngine};

#[doc(hidden)]
impl Deformer {
    /// Limits SIMD to this many lanes (4, 8 or 16), whatever the processor supports, and returns the number used.
    pub fn at_most_lanes(&mut self, lanes: usize) -> usize {
        let width = Width::at_most(lanes);
        self.engine.cpu_mut().into_iter().for_each(|cpu| cpu.narrow(width));
        width.lanes()
    }

    /// Runs the passes as parallel loops one after another instead of as a task graph.
    pub fn loop_by_loop(&mut self, loops: bool) {
        self.engine.cpu_mut().into_iter().for_each(|cpu| cpu.loop_by_loop = loops);
    }

    /// Steps on this many threads, if the pool has that many, instead of on as many as pay off.
    pub fn on_threads(&mut self, threads: usize) {
        self.engine.cpu_mut().into_iter().for_each(|cpu| cpu.on_threads(threads));
    }

    /// Counters of contact in the last step: pressing pairs, detections, listed pairs, near pairs.
    #[must_use]
    pub fn contact_tally(&self) -> [u32; 4] {
        let of = |tally: Tally| [tally.contacts, tally.detections, tally.listed, tally.near];
        self.engine.contact().map_or([0; 4], of)
    }

    /// Number of dispatches that the last step submitted to the GPU.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn dispatches(&self) -> Option<usize> {
        match &self.engine {
            Engine::Gpu(gpu) => Some(gpu.dispatches),
            _ => None,
        }
    }

    /// Makes room for so few pairs in the list of contact on the GPU, before the first step.
    ///
    /// # Errors
    /// As [`Deformer::step`].
    #[cfg(feature = "gpu")]
    pub fn contact_room(&mut self, pairs: usize) -> Result<(), StepError> {
        let Engine::Gpu(gpu) = &mut self.engine else { return Ok(()) };
        let GpuEngine { gpu, contact, .. } = &mut **gpu;
        let made = gpu.checked(|| {
            contact.iter_mut().for_each(|contact| contact.make_room(gpu, pairs, pairs));
            Ok(())
        });
        made.map_err(|fault| self.failed(Failure::Gpu(fault)))
    }

    /// Collects the sums of contact on the GPU in workgroups from so many acting pairs on.
    #[cfg(feature = "gpu")]
    pub fn collect_contact_from(&mut self, pairs: u32) {
        if let Engine::Gpu(gpu) = &mut self.engine {
            gpu.contact.iter_mut().for_each(|contact| contact.many = pairs);
        }
    }

    /// How many pairs the list of contact on the GPU has room for.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn has_contact_room(&self) -> usize {
        let Engine::Gpu(gpu) = &self.engine else { return 0 };
        gpu.contact.as_ref().map_or(0, |contact| contact.room)
    }

    /// Whether the device accesses the hybrid's mapped outbox and inbox directly, without a copy.
    #[cfg(feature = "gpu")]
    pub fn exchange_in_place(&mut self, in_place: [bool; 2]) {
        if let Engine::Hybrid(hybrid) = &mut self.engine {
            hybrid.exchange_in_place(in_place);
        }
    }

    /// Runs the hybrid's force kernels of one substep `repeats` times and waits. The state does not change.
    ///
    /// # Errors
    /// As [`Deformer::step`].
    #[cfg(feature = "gpu")]
    pub fn run_forces(&mut self, dt: f32, attributes: &Attributes, repeats: u32) -> Result<(), StepError> {
        let Some(decision) = self.prepare(dt, attributes)? else { return Ok(()) };
        let (engine, plan) = self.plan(&decision, attributes);
        let Engine::Hybrid(hybrid) = engine else { return Ok(()) };
        let run = hybrid.run_forces(&plan, repeats);
        run.map_err(|fault| self.failed(Failure::Gpu(fault)))
    }
}
