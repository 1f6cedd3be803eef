//! A GPU device: its buffers, pipelines, submissions, reads and errors.

mod buffers;
mod errors;
pub(crate) mod fault;
mod pipelines;
pub(crate) mod reads;

pub(crate) use pipelines::{Entry, Pipeline, Shader};

use std::sync::{Arc, Mutex, PoisonError};

use crate::device::fault::GpuFault;
use crate::device::pipelines::Pipelines;

/// A wgpu device and queue to compute on. Cheap to clone.
///
/// Clones share the compiled pipelines, which are stored with the device they belong to.
#[derive(Debug, Clone)]
pub struct Gpu(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    pipelines: Pipelines,
}

/// A browser runs GPU callbacks only between calls from JavaScript, so the crate can never wait for the device there.
pub(crate) const IN_BROWSER: bool = cfg!(target_arch = "wasm32");

impl Gpu {
    /// Wraps a device and its queue; `name` is used in reports. A device with `wgpu::Limits::default()` suffices, except that
    /// large meshes need larger `max_storage_buffer_binding_size` and `max_buffer_size`. Clones share the compiled kernels, so
    /// give clones of one `Gpu` to all cloths on that device. [`Deformer::step_all`](crate::Deformer::step_all) submits cloths that
    /// share one together.
    #[must_use]
    pub fn new(device: wgpu::Device, queue: wgpu::Queue, name: String) -> Gpu {
        Gpu(Arc::new(Inner { device, queue, name, pipelines: Pipelines::default() }))
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &wgpu::Device {
        &self.0.device
    }

    /// The device's queue.
    #[must_use]
    pub fn queue(&self) -> &wgpu::Queue {
        &self.0.queue
    }

    /// The name of the adapter, for reports.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Whether a driver computes on the CPU.
    pub(crate) fn is_software(&self) -> bool {
        self.0.device.adapter_info().device_type == wgpu::DeviceType::Cpu
    }

    /// Identifies the device. wgpu's own comparison considers the first devices of two instances equal.
    pub(crate) fn id(&self) -> *const () {
        Arc::as_ptr(&self.0).cast()
    }

    /// The best adapter of this machine: a hardware GPU, or the software driver if there is none and `software` allows
    /// it.
    ///
    /// The device is requested once per program and shared, because drivers limit the number of devices. It is
    /// requested again if it was lost.
    pub(crate) fn shared(software: bool) -> Result<Gpu, GpuFault> {
        static FOUND: Mutex<Option<Gpu>> = Mutex::new(None);
        let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
        let gpu = match found.take().filter(|gpu| !gpu.is_lost()) {
            Some(gpu) => gpu,
            None => Gpu::request()?,
        };
        *found = Some(gpu.clone());
        if software || !gpu.is_software() { Ok(gpu) } else { Err(GpuFault::other("the only adapter is a software driver")) }
    }

    fn request() -> Result<Gpu, GpuFault> {
        if IN_BROWSER {
            let reason = "a browser provides devices asynchronously; request one and pass it as Options::gpu";
            return Err(GpuFault::other(reason));
        }
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let rank = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        let best = adapters.into_iter().min_by_key(rank);
        let adapter = best.ok_or_else(|| GpuFault::other("no adapter was found; install a Vulkan, Metal or DX12 driver"))?;
        let descriptor = wgpu::DeviceDescriptor {
            // Cloth of a million vertices needs bindings larger than wgpu's default of 128 MiB.
            required_limits: adapter.limits(),
            // Lets the hybrid use its mapped buffers without a copy.
            required_features: adapter.features() & wgpu::Features::MAPPABLE_PRIMARY_BUFFERS,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).map_err(GpuFault::other)?;
        Ok(Gpu::new(device, queue, adapter.get_info().name))
    }

    /// A command encoder.
    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }
}
