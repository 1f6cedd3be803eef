//! Positions on their way back while the GPU goes on.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use glam::Vec4;

use super::device::Gpu;

/// What has become of a request.
const UNDER_WAY: u8 = 0;
const ARRIVED: u8 = 1;
const LOST: u8 = 2;

/// The positions after some steps and whether those were good, copied behind them.
#[derive(Debug)]
pub(super) struct Snapshot {
    staging: wgpu::Buffer,
    /// Told by whoever polls the device.
    state: Arc<AtomicU8>,
}

impl Snapshot {
    /// Asks for `x` and `first_bad` as they are behind what is submitted.
    pub(super) fn new(gpu: &Gpu, x: &wgpu::Buffer, first_bad: &wgpu::Buffer) -> Result<Snapshot, String> {
        gpu.checked(|| {
            let staging = gpu.staging("snapshot", x.size() + first_bad.size());
            let mut encoder = gpu.encoder();
            encoder.copy_buffer_to_buffer(x, 0, &staging, 0, x.size());
            encoder.copy_buffer_to_buffer(first_bad, 0, &staging, x.size(), first_bad.size());
            gpu.queue.submit([encoder.finish()]);
            let state = Arc::new(AtomicU8::new(UNDER_WAY));
            let told = Arc::clone(&state);
            staging.map_async(wgpu::MapMode::Read, .., move |mapped| {
                told.store(if mapped.is_ok() { ARRIVED } else { LOST }, Ordering::Release);
            });
            Ok(Snapshot { staging, state })
        })
    }

    /// Shows the positions and the first bad vertex to `look` if they have arrived.
    pub(super) fn look<T>(&self, gpu: &Gpu, look: impl FnOnce(&[Vec4], u32) -> T) -> Result<Option<T>, String> {
        gpu.poll(wgpu::PollType::Poll)?;
        match self.state.load(Ordering::Acquire) {
            UNDER_WAY => Ok(None),
            ARRIVED => {
                let bytes = self.staging.get_mapped_range(..).map_err(|error| error.to_string())?;
                let (x, first_bad) = bytes.split_at(bytes.len() - size_of::<u32>());
                Ok(Some(look(bytemuck::cast_slice(x), bytemuck::pod_read_unaligned(first_bad))))
            }
            _ => Err("the positions asked for could not be mapped".to_owned()),
        }
    }
}
