//! Reading buffers back, and waiting for the device.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use web_time::Instant;

use crate::device::fault::GpuFault;
use crate::device::{Gpu, IN_BROWSER};

/// How long a thread that waits for the device polls before it sleeps. A sleeping thread wakes up 0.05 to 0.3 ms late.
const AWAKE: Duration = Duration::from_millis(4);
/// How long a callback may take after the device has finished.
const PATIENCE: Duration = Duration::from_secs(2);

fn may_wait() -> Result<(), GpuFault> {
    let why = "a browser does not wait for the GPU; request_positions asks, requested_positions has them later";
    if IN_BROWSER { Err(GpuFault::other(why)) } else { Ok(()) }
}

/// A staging buffer whose bytes were asked for and are read later.
pub(crate) struct Mapping {
    pub staging: wgpu::Buffer,
    /// The one that copies them there.
    submission: Option<wgpu::SubmissionIndex>,
    /// Whether it could be mapped: set by the callback when the device is polled, which every submission does.
    told: Arc<OnceLock<bool>>,
}

impl Mapping {
    /// Asks for the bytes of `staging` after everything submitted, of which the `submission` is the last, if it is to be waited for.
    pub(crate) fn new(staging: wgpu::Buffer, submission: Option<wgpu::SubmissionIndex>) -> Mapping {
        let told = Arc::new(OnceLock::new());
        let tell = Arc::clone(&told);
        staging.map_async(wgpu::MapMode::Read, .., move |result| _ = tell.set(result.is_ok()));
        Mapping { staging, submission, told }
    }

    /// Whether the device has answered.
    pub(crate) fn is_told(&self) -> bool {
        self.told.get().is_some()
    }

    /// Waits until the device has answered.
    pub(crate) fn wait(&self, gpu: &Gpu) -> Result<(), GpuFault> {
        gpu.poll(wgpu::PollType::Poll)?;
        if !self.is_told() {
            gpu.poll(wgpu::PollType::Wait { submission_index: self.submission.clone(), timeout: None })?;
            gpu.wait_for(|| self.is_told())?;
        }
        Ok(())
    }

    /// Passes the bytes to `read` if they have arrived, after which the buffer can be used again. `thing` names them in errors.
    pub(crate) fn read<T>(&self, gpu: &Gpu, thing: &str, read: impl FnOnce(&[u8]) -> T) -> Result<Option<T>, GpuFault> {
        match self.told.get() {
            None => return Ok(None),
            Some(false) => return Err(gpu.unmapped(thing)),
            Some(true) => {}
        }
        // A device that is lost by now has neither the bytes nor the buffer.
        gpu.checked(|| {
            let seen = self.staging.get_mapped_range(..).map(|bytes| read(&bytes)).map_err(GpuFault::other);
            self.staging.unmap();
            seen.map(Some)
        })
    }
}

impl Gpu {
    /// Copies buffers into `staging`, one after another.
    pub(crate) fn copy_to(&self, staging: &wgpu::Buffer, buffers: &[&wgpu::Buffer]) -> wgpu::SubmissionIndex {
        let mut encoder = self.encoder();
        let mut offset = 0;
        for buffer in buffers {
            encoder.copy_buffer_to_buffer(buffer, 0, staging, offset, buffer.size());
            offset += buffer.size();
        }
        self.queue().submit([encoder.finish()])
    }

    /// Copies buffers into `staging`, one after another, waits, and passes the bytes to `read`.
    pub(crate) fn read<T>(
        &self,
        staging: &wgpu::Buffer,
        buffers: &[&wgpu::Buffer],
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, GpuFault> {
        may_wait()?;
        self.checked(|| {
            self.copy_to(staging, buffers);
            self.mapped(staging, read)
        })
    }

    /// Waits for what was submitted, and shows the bytes of `staging` to `read`.
    pub(crate) fn mapped<T>(&self, staging: &wgpu::Buffer, read: impl FnOnce(&[u8]) -> T) -> Result<T, GpuFault> {
        may_wait()?;
        self.checked(|| {
            // A substitute for a refused buffer does not have the bytes.
            Gpu::refused()?;
            let mapping = Mapping::new(staging.clone(), None);
            self.wait()?;
            self.wait_for(|| mapping.is_told())?;
            mapping.read(self, "what was read", read)?.ok_or_else(|| self.unmapped("what was read"))
        })
    }

    /// Waits for everything submitted.
    pub(crate) fn wait(&self) -> Result<(), GpuFault> {
        let begin = Instant::now();
        while begin.elapsed() < AWAKE {
            if self.poll(wgpu::PollType::Poll)?.is_queue_empty() {
                return Ok(());
            }
            std::thread::yield_now();
        }
        self.poll(wgpu::PollType::wait_indefinitely()).map(drop)
    }

    /// Waits for callbacks of work that the device has completed, except in a browser. They may be called by another thread that also
    /// waits for the device, a moment later.
    pub(crate) fn wait_for(&self, are_called: impl Fn() -> bool) -> Result<(), GpuFault> {
        let begin = Instant::now();
        while !IN_BROWSER && !are_called() && begin.elapsed() < PATIENCE {
            std::thread::yield_now();
            self.poll(wgpu::PollType::Poll)?;
        }
        Ok(())
    }

    /// Runs the callbacks of completed work.
    pub(crate) fn poll(&self, how: wgpu::PollType) -> Result<wgpu::PollStatus, GpuFault> {
        // wgpu 30 panics here when the device is lost, where its type says that it returns an error.
        let poll = || self.device().poll(how);
        match std::panic::catch_unwind(std::panic::AssertUnwindSafe(poll)) {
            Ok(polled) => polled.map_err(GpuFault::other),
            Err(_) => Err(GpuFault::Lost),
        }
    }
}
