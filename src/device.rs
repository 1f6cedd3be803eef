//! A GPU device: its buffers, pipelines, submissions, reads and errors.

use std::cell::Cell;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytemuck::Pod;
use web_time::Instant;

use crate::gpu_fault::{Excess, GpuFault};

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
    /// Cached, because compiling takes longer than everything else that a small cloth needs.
    pipelines: Mutex<HashMap<Key, wgpu::ComputePipeline>>,
}

/// Shader, entry point, and its constants as bits.
type Key = (&'static str, &'static str, Vec<(&'static str, u64)>);

/// The source of a shader, with a unique name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shader {
    pub name: &'static str,
    pub source: &'static str,
}

/// An entry point of a shader, with the values of its overridable constants.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry<'a> {
    pub shader: Shader,
    pub name: &'static str,
    pub constants: &'a [(&'static str, f64)],
}

/// The device that all Deformers share, unless the caller gives one.
struct Found {
    gpu: Gpu,
    software: bool,
    lost: Arc<AtomicBool>,
}

/// A browser runs GPU callbacks only between calls from JavaScript, so the crate can never wait for the device there.
pub(crate) const IN_BROWSER: bool = cfg!(target_arch = "wasm32");

/// How long a thread that waits for the device polls before it sleeps. A sleeping thread wakes up 0.05 to 0.3 ms late.
const AWAKE: Duration = Duration::from_millis(4);

thread_local! {
    /// What [`Gpu::make`] refused since [`Gpu::checked`] began. It is thread-local, as wgpu's error scopes are.
    static REFUSED: Cell<Option<Excess>> = const { Cell::new(None) };
}

impl Found {
    fn request() -> Result<Found, GpuFault> {
        if IN_BROWSER {
            return Err("a browser provides devices asynchronously; request one and pass it as Options::gpu".into());
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
        let adapter = adapters.into_iter().min_by_key(rank).ok_or("no adapter was found")?;
        let descriptor = wgpu::DeviceDescriptor {
            // Cloth of a million vertices needs bindings larger than wgpu's default of 128 MiB.
            required_limits: adapter.limits(),
            // Lets the hybrid use its mapped buffers without a copy.
            required_features: adapter.features() & wgpu::Features::MAPPABLE_PRIMARY_BUFFERS,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| GpuFault::from(error.to_string()))?;
        let lost = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&lost);
        device.set_device_lost_callback(move |_, _| flag.store(true, Ordering::Relaxed));
        let gpu = Gpu::new(device, queue, adapter.get_info().name);
        Ok(Found { gpu, software: rank(&adapter) == 4, lost })
    }
}

impl Gpu {
    /// Wraps a device and its queue; `name` is used in reports. Clones share the compiled kernels, so give clones of
    /// one `Gpu` to all cloths on that device. [`Deformer::step_all`](crate::Deformer::step_all) submits cloths that
    /// share one together.
    #[must_use]
    pub fn new(device: wgpu::Device, queue: wgpu::Queue, name: String) -> Gpu {
        Gpu(Arc::new(Inner { device, queue, name, pipelines: Mutex::default() }))
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
        static FOUND: Mutex<Option<Found>> = Mutex::new(None);
        let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
        if found.as_ref().is_none_or(|found| found.lost.load(Ordering::Relaxed)) {
            *found = Some(Found::request()?);
        }
        match found.as_ref() {
            Some(found) if software || !found.software => Ok(found.gpu.clone()),
            _ => Err("the only adapter is a software driver".into()),
        }
    }

    /// Runs `work` and returns as an error what would otherwise be an uncaptured error of the device (validation,
    /// memory), what [`Gpu::make`] refused, and failures due to a lost device, which wgpu does not report itself. In a
    /// browser, device errors appear in its console instead.
    pub(crate) fn checked<T>(&self, work: impl FnOnce() -> Result<T, GpuFault>) -> Result<T, GpuFault> {
        let filters = [wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Internal];
        let scopes = (!IN_BROWSER).then(|| filters.map(|filter| self.device().push_error_scope(filter)));
        REFUSED.set(None);
        let result = work();
        let errors = scopes.map_or([None, None, None], |[validation, memory, internal]| {
            [pollster::block_on(internal.pop()), pollster::block_on(memory.pop()), pollster::block_on(validation.pop())]
        });
        // The first cause matters: whatever was refused or did not fit causes the errors after it.
        let refused = REFUSED.take().map(GpuFault::Limit);
        let error = refused
            .or_else(|| errors.into_iter().flatten().next().map(GpuFault::from))
            .or_else(|| result.as_ref().err().cloned());
        match error {
            None => result,
            Some(fault @ (GpuFault::Limit(_) | GpuFault::Memory(_))) => Err(fault),
            Some(fault) => Err(if self.is_lost() { GpuFault::Lost } else { fault }),
        }
    }

    /// Fails if [`Gpu::make`] refused a buffer since [`Gpu::checked`] began, because work that uses it must not run.
    pub(crate) fn refused() -> Result<(), GpuFault> {
        REFUSED.get().map_or(Ok(()), |excess| Err(GpuFault::Limit(excess)))
    }

    /// Whether the device is lost. wgpu reports this to a callback, but a device has only one, which belongs to its
    /// owner. A lost device also fails to map a buffer, and does so at once, so this maps a small one.
    pub(crate) fn is_lost(&self) -> bool {
        if IN_BROWSER {
            return false;
        }
        let scope = self.device().push_error_scope(wgpu::ErrorFilter::Validation);
        let descriptor = wgpu::BufferDescriptor {
            label: Some("probe"),
            size: 4,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        let refused = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&refused);
        let probe = self.device().create_buffer(&descriptor);
        probe.map_async(wgpu::MapMode::Read, .., move |mapped| told.store(mapped.is_err(), Ordering::Relaxed));
        let is_lost = refused.load(Ordering::Relaxed);
        drop(pollster::block_on(scope.pop()));
        is_lost
    }

    /// The error for something that could not be mapped.
    pub(crate) fn unmapped(&self, thing: &str) -> GpuFault {
        if self.is_lost() || IN_BROWSER { GpuFault::Lost } else { format!("{thing} could not be mapped").into() }
    }

    /// The largest storage buffer (bytes), with the name of the limit that decides.
    fn most_bytes(&self) -> (&'static str, u64) {
        let wgpu::Limits { max_storage_buffer_binding_size, max_buffer_size, .. } = self.device().limits();
        let limits = [("max_storage_buffer_binding_size", max_storage_buffer_binding_size), ("max_buffer_size", max_buffer_size)];
        if limits[0].1 < limits[1].1 { limits[0] } else { limits[1] }
    }

    /// The largest table (bytes).
    pub(crate) fn most_table_bytes(&self) -> usize {
        usize::try_from(self.most_bytes().1).unwrap_or(usize::MAX)
    }

    /// Fails if the device is lost, lacks what every stage needs, or cannot hold a storage buffer of `bytes`.
    pub(crate) fn meets(&self, thing: &'static str, bytes: u64) -> Result<(), GpuFault> {
        let limits = self.device().limits();
        let (limit, allowed) = self.most_bytes();
        let needs = [
            (thing, bytes, limit, allowed),
            (
                "storage buffers of a stage",
                8,
                "max_storage_buffers_per_shader_stage",
                limits.max_storage_buffers_per_shader_stage.into(),
            ),
            (
                "threads of a workgroup",
                64,
                "max_compute_invocations_per_workgroup",
                limits.max_compute_invocations_per_workgroup.into(),
            ),
            ("threads of a workgroup", 64, "max_compute_workgroup_size_x", limits.max_compute_workgroup_size_x.into()),
            ("workgroups", 65_535, "max_compute_workgroups_per_dimension", limits.max_compute_workgroups_per_dimension.into()),
        ];
        if self.is_lost() {
            return Err(GpuFault::Lost);
        }
        match needs.into_iter().find(|&(_, needed, _, allowed)| needed > allowed) {
            Some((thing, needed, limit, allowed)) => Err(GpuFault::Limit(Excess { thing, needed, limit, allowed })),
            None => Ok(()),
        }
    }

    /// Workgroup memory (bytes).
    pub(crate) fn workgroup_memory(&self) -> usize {
        self.device().limits().max_compute_workgroup_storage_size as usize
    }

    /// A storage buffer of `size` bytes, all zero.
    pub(crate) fn buffer(&self, label: &'static str, size: u64) -> wgpu::Buffer {
        self.buffer_for(label, size, wgpu::BufferUsages::empty())
    }

    /// A storage buffer of `size` bytes, all zero, that a renderer may use too.
    pub(crate) fn buffer_for(&self, label: &'static str, size: u64, renderer: wgpu::BufferUsages) -> wgpu::Buffer {
        use wgpu::BufferUsages;
        self.make(label, size, BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC | renderer)
    }

    /// A storage buffer with these values; a single zero item if there are none.
    pub(crate) fn filled<T: Pod>(&self, label: &'static str, values: &[T]) -> wgpu::Buffer {
        let buffer = self.buffer(label, size_of_val(values).max(size_of::<T>()) as u64);
        self.write(&buffer, 0, values);
        buffer
    }

    /// A buffer to map for reading.
    pub(crate) fn staging(&self, label: &'static str, size: u64) -> wgpu::Buffer {
        self.make(label, size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)
    }

    /// Creates a buffer. If it exceeds the device's limits, a small substitute is returned, and [`Gpu::checked`] fails
    /// before anything uses it.
    pub(crate) fn make(&self, label: &'static str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let size = size.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        let (limit, allowed) = match usage.contains(wgpu::BufferUsages::STORAGE) {
            true => self.most_bytes(),
            false => ("max_buffer_size", self.device().limits().max_buffer_size),
        };
        if size > allowed {
            let first = REFUSED.get().unwrap_or(Excess { thing: label, needed: size, limit, allowed });
            REFUSED.set(Some(first));
        }
        let size = if size > allowed { wgpu::COPY_BUFFER_ALIGNMENT } else { size };
        self.device().create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
    }

    /// Writes values at byte `start` of a buffer, ahead of the next submission.
    pub(crate) fn write<T: Pod>(&self, buffer: &wgpu::Buffer, start: usize, values: &[T]) {
        self.queue().write_buffer(buffer, start as u64, bytemuck::cast_slice(values));
    }

    /// The pipeline of an entry point, compiled on first use.
    pub(crate) fn pipeline(&self, entry: Entry<'_>, layouts: [&wgpu::BindGroupLayout; 2]) -> wgpu::ComputePipeline {
        let device = self.device();
        let constants = entry.constants.iter().map(|(name, value)| (*name, value.to_bits())).collect();
        let mut pipelines = self.0.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        let pipeline = pipelines.entry((entry.shader.name, entry.name, constants)).or_insert_with(|| {
            let source = wgpu::ShaderSource::Wgsl(entry.shader.source.into());
            let module = wgpu::ShaderModuleDescriptor { label: Some(entry.shader.name), source };
            let module = device.create_shader_module(module);
            let bind_group_layouts = &layouts.map(Some);
            let layout = wgpu::PipelineLayoutDescriptor { label: Some(entry.name), bind_group_layouts, immediate_size: 0 };
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry.name),
                layout: Some(&device.create_pipeline_layout(&layout)),
                module: &module,
                entry_point: Some(entry.name),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: entry.constants,
                    // Every kernel writes workgroup memory before it reads it.
                    zero_initialize_workgroup_memory: false,
                },
                cache: None,
            })
        });
        pipeline.clone()
    }

    /// A command encoder.
    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

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

    /// Copies buffers into `staging`, one after another, waits, and passes the bytes to `look`.
    pub(crate) fn read<T>(
        &self,
        staging: &wgpu::Buffer,
        buffers: &[&wgpu::Buffer],
        look: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, GpuFault> {
        if IN_BROWSER {
            return Err("a browser does not wait for the GPU; request_positions asks, requested_positions has them later".into());
        }
        self.checked(|| {
            self.copy_to(staging, buffers);
            self.mapped(staging, look)
        })
    }

    /// Waits for what was submitted, and shows the bytes of `staging` to `look`.
    pub(crate) fn mapped<T>(&self, staging: &wgpu::Buffer, look: impl FnOnce(&[u8]) -> T) -> Result<T, GpuFault> {
        self.checked(|| {
            let (send, receive) = std::sync::mpsc::channel();
            staging.map_async(wgpu::MapMode::Read, .., move |mapped| {
                // The receiver waits below. If it has given up, nobody needs the message.
                let _ = send.send(mapped);
            });
            self.wait()?;
            receive
                .recv()
                .map_err(|error| GpuFault::from(error.to_string()))?
                .map_err(|error| GpuFault::from(error.to_string()))?;
            let seen = staging.get_mapped_range(..).map(|bytes| look(&bytes)).map_err(|error| GpuFault::from(error.to_string()));
            staging.unmap();
            seen
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

    /// Runs the callbacks of completed work.
    pub(crate) fn poll(&self, how: wgpu::PollType) -> Result<wgpu::PollStatus, GpuFault> {
        // wgpu 30 panics here when the device is lost, where its type says that it returns an error.
        let poll = || self.device().poll(how);
        match std::panic::catch_unwind(std::panic::AssertUnwindSafe(poll)) {
            Ok(polled) => polled.map_err(|error| GpuFault::from(error.to_string())),
            Err(_) => Err(GpuFault::Lost),
        }
    }
}
