//! What the benches of the GPU share: a device of their own.

use cloth_deformer::{Gpu, wgpu};

/// The best adapter with all its limits, and those of these features that it has.
pub(crate) fn request(features: wgpu::Features) -> Option<Gpu> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let power_preference = wgpu::PowerPreference::HighPerformance;
    let wanted = wgpu::RequestAdapterOptions { power_preference, ..wgpu::RequestAdapterOptions::default() };
    let adapter = pollster::block_on(instance.request_adapter(&wanted)).ok()?;
    let descriptor = wgpu::DeviceDescriptor {
        required_features: adapter.features() & features,
        required_limits: adapter.limits(),
        ..wgpu::DeviceDescriptor::default()
    };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).ok()?;
    Some(Gpu::new(device, queue, adapter.get_info().name))
}
