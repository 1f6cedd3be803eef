//! The state on its way back to the CPU: waited for, or asked for and looked at while the GPU goes on.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use glam::Vec4;

use crate::device::Gpu;
use crate::gpu::state::State;

/// What has become of a request.
const UNDER_WAY: u8 = 0;
const ARRIVED: u8 = 1;
const LOST: u8 = 2;

/// The staging buffer of reads that wait, and the request that has not been seen.
#[derive(Debug)]
pub(crate) struct Readback {
    staging: wgpu::Buffer,
    request: Option<Request>,
}

/// Positions after some steps and whether those were good, copied behind them.
#[derive(Debug)]
struct Request {
    staging: wgpu::Buffer,
    /// Told by whoever polls the device.
    progress: Arc<AtomicU8>,
}

impl Readback {
    pub(crate) fn new(gpu: &Gpu, state: &State, first_bad: &wgpu::Buffer) -> Readback {
        let size = state.x.size() + state.p.size() + first_bad.size();
        Readback { staging: gpu.staging("state", size), request: None }
    }

    /// Waits for the state and shows it to `look`; returns the first bad vertex.
    pub(crate) fn read(
        &self,
        gpu: &Gpu,
        state: &State,
        first_bad: &wgpu::Buffer,
        look: impl FnOnce(&[Vec4], &[Vec4]),
    ) -> Result<u32, String> {
        gpu.read(&self.staging, &[&state.x, &state.p, first_bad], |bytes| {
            let (state, first_bad) = bytes.split_at(bytes.len() - size_of::<u32>());
            let state: &[Vec4] = bytemuck::cast_slice(state);
            let (x, p) = state.split_at(state.len() / 2);
            look(x, p);
            bytemuck::pod_read_unaligned(first_bad)
        })
    }

    /// Asks for the positions behind what is submitted, in place of what was asked for before.
    pub(crate) fn request(&mut self, gpu: &Gpu, x: &wgpu::Buffer, first_bad: &wgpu::Buffer) -> Result<(), String> {
        gpu.checked(|| {
            let staging = gpu.staging("positions", x.size() + first_bad.size());
            gpu.copy_to(&staging, &[x, first_bad]);
            let progress = Arc::new(AtomicU8::new(UNDER_WAY));
            let told = Arc::clone(&progress);
            staging.map_async(wgpu::MapMode::Read, .., move |mapped| {
                told.store(if mapped.is_ok() { ARRIVED } else { LOST }, Ordering::Release);
            });
            self.request = Some(Request { staging, progress });
            Ok(())
        })
    }

    /// Shows the positions asked for to `look`, once, if they have arrived; then returns the first bad vertex.
    pub(crate) fn arrived(&mut self, gpu: &Gpu, look: impl FnOnce(&[Vec4])) -> Result<Option<u32>, String> {
        let Some(Request { staging, progress }) = &self.request else { return Ok(None) };
        gpu.poll(wgpu::PollType::Poll)?;
        let first_bad = match progress.load(Ordering::Acquire) {
            UNDER_WAY => return Ok(None),
            ARRIVED => {
                let bytes = staging.get_mapped_range(..).map_err(|error| error.to_string())?;
                let (x, first_bad) = bytes.split_at(bytes.len() - size_of::<u32>());
                look(bytemuck::cast_slice(x));
                bytemuck::pod_read_unaligned(first_bad)
            }
            _ => return Err("the positions asked for could not be mapped".to_owned()),
        };
        self.request = None;
        Ok(Some(first_bad))
    }
}
