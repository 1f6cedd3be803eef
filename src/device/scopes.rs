//! The errors of a device that a thread causes, from wgpu's error scopes.

use crate::device::IN_BROWSER;
use crate::device::fault::GpuFault;

/// Runs `work`, and returns with its result the error of the device that it caused on this thread.
pub(super) fn scoped<T>(device: &wgpu::Device, work: impl FnOnce() -> T) -> (T, Option<GpuFault>) {
    let filters = [wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Internal];
    let scopes = (!IN_BROWSER).then(|| filters.map(|filter| device.push_error_scope(filter)));
    let result = work();
    let errors = scopes.map_or([None, None, None], |[validation, memory, internal]| {
        [pollster::block_on(internal.pop()), pollster::block_on(memory.pop()), pollster::block_on(validation.pop())]
    });
    (result, errors.into_iter().flatten().next().map(GpuFault::from))
}
