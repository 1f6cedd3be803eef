//! Reading the state back: waiting for it, or requesting it and looking later while the GPU continues.

use glam::Vec4;

use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::device::reads::Mapping;
use crate::gpu::state::StateBuffers;
use crate::gpu::watch::Defects;

/// The staging buffer of reads that wait, and the request that has not been read yet: positions after some steps and the result of
/// their check, copied after those steps.
pub(crate) struct Readback {
    staging: wgpu::Buffer,
    request: Option<Mapping>,
}

impl Readback {
    pub(crate) fn new(gpu: &Gpu, state: &StateBuffers, found: &wgpu::Buffer) -> Readback {
        let size = state.x.size() + state.p.size() + found.size();
        Readback { staging: gpu.staging("state", size), request: None }
    }

    /// Waits for the state and passes it to `read`; returns the result of the steps' checks.
    pub(crate) fn read(
        &self,
        gpu: &Gpu,
        state: &StateBuffers,
        found: &wgpu::Buffer,
        read: impl FnOnce(&[Vec4], &[Vec4]),
    ) -> Result<Defects, GpuFault> {
        gpu.read(&self.staging, &[&state.x, &state.p, found], |bytes| {
            let (state, found) = bytes.split_at(bytes.len() - size_of::<Defects>());
            let state: &[Vec4] = bytemuck::cast_slice(state);
            let (x, p) = state.split_at(state.len() / 2);
            read(x, p);
            bytemuck::pod_read_unaligned(found)
        })
    }

    /// Requests the positions after everything submitted, in place of the previous request.
    pub(crate) fn request(&mut self, gpu: &Gpu, x: &wgpu::Buffer, found: &wgpu::Buffer) -> Result<(), GpuFault> {
        gpu.checked(|| {
            let staging = gpu.staging("positions", x.size() + found.size());
            gpu.copy_to(&staging, &[x, found]);
            self.request = Some(Mapping::new(staging, None));
            Ok(())
        })
    }

    /// Drops the request.
    pub(crate) fn forget(&mut self) {
        self.request = None;
    }

    /// Passes the requested positions to `read`, once, if they have arrived; returns the result of the steps' checks.
    pub(crate) fn arrived(&mut self, gpu: &Gpu, read: impl FnOnce(&[Vec4])) -> Result<Option<Defects>, GpuFault> {
        let Some(request) = &self.request else { return Ok(None) };
        gpu.poll(wgpu::PollType::Poll)?;
        let found = request.read(gpu, "the positions asked for", |bytes| {
            let (x, found) = bytes.split_at(bytes.len() - size_of::<Defects>());
            match bytemuck::try_cast_slice(x) {
                Ok(x) => read(x),
                // In a browser the mapped bytes may have any alignment.
                Err(_) => read(&bytemuck::pod_collect_to_vec(x)),
            }
            bytemuck::pod_read_unaligned(found)
        })?;
        self.request.take_if(|_| found.is_some());
        Ok(found)
    }
}
