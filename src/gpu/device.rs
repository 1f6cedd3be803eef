//! A device, and the few things made on it: buffers, stages, reads.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bytemuck::Pod;

/// A wgpu device and queue to compute on. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// The adapter's name, for reports.
    pub name: String,
    pipelines: Arc<Pipelines>,
}

/// The device that Deformers share.
struct Found {
    gpu: Gpu,
    software: bool,
    lost: Arc<AtomicBool>,
}

impl Found {
    fn request() -> Result<Found, String> {
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
            // Cloth of a million vertices needs more than the default 128 MiB a binding.
            required_limits: adapter.limits(),
            // So that the hybrid need not copy what it maps.
            required_features: adapter.features() & wgpu::Features::MAPPABLE_PRIMARY_BUFFERS,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| error.to_string())?;
        let lost = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&lost);
        device.set_device_lost_callback(move |_, _| flag.store(true, Ordering::Relaxed));
        let gpu = Gpu::new(device, queue, adapter.get_info().name);
        Ok(Found { gpu, software: rank(&adapter) == 4, lost })
    }
}

/// A shader: the common part, what it shares with some others, and its own.
macro_rules! shader {
    ($($name:literal),+) => {
        concat!(
            include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/common.wgsl")),
            $(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $name, ".wgsl"))),+
        )
    };
}
pub(crate) use shader;

/// Invocations in a workgroup: `WORKGROUP` of `common.wgsl`.
pub(crate) const WORKGROUP: usize = 64;
/// How long a thread that waits for the device stays awake: one that sleeps is woken .05 to .3 ms late.
const AWAKE: Duration = Duration::from_millis(4);
/// Most workgroups in a dimension of a dispatch.
const MAX_GROUPS: usize = 65_535;

impl Gpu {
    /// A device and its queue, by a name for reports. Clones share the kernels compiled for them: give one to each cloth, and
    /// to [`Deformer::step_all`](crate::Deformer::step_all) cloths of one.
    #[must_use]
    pub fn new(device: wgpu::Device, queue: wgpu::Queue, name: String) -> Gpu {
        Gpu { device, queue, name, pipelines: Arc::default() }
    }

    /// Which device it is: wgpu's own comparison takes the first devices of two instances for one.
    pub(crate) fn id(&self) -> *const () {
        Arc::as_ptr(&self.pipelines).cast()
    }

    /// The best adapter of this machine: a real GPU, or, if `software` may stand in, the software driver.
    ///
    /// Asked for once in a program and shared: a driver hands out only so many devices. Asked for again if it was lost.
    pub(crate) fn shared(software: bool) -> Result<Gpu, String> {
        static FOUND: Mutex<Option<Found>> = Mutex::new(None);
        let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
        if found.as_ref().is_none_or(|found| found.lost.load(Ordering::Relaxed)) {
            *found = Some(Found::request()?);
        }
        match found.as_ref() {
            Some(found) if software || !found.software => Ok(found.gpu.clone()),
            _ => Err("the only adapter is a software driver".to_owned()),
        }
    }

    /// Runs `work` and turns what the device would report as uncaptured (validation, memory) into an error.
    pub(crate) fn checked<T>(&self, work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        checked(&self.device, work)
    }

    /// A storage buffer of `size` bytes, zero.
    pub(crate) fn buffer(&self, label: &str, size: u64) -> wgpu::Buffer {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        self.make(label, size, usage)
    }

    /// A storage buffer that a renderer may take vertices from.
    pub(crate) fn vertex_buffer(&self, label: &str, size: u64) -> wgpu::Buffer {
        use wgpu::BufferUsages;
        self.make(label, size, BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC | BufferUsages::VERTEX)
    }

    /// A storage buffer with these triangles, one of zeros if there are none, that a renderer may take indices from.
    pub(crate) fn index_buffer(&self, label: &str, triangles: &[[u32; 3]]) -> wgpu::Buffer {
        use wgpu::BufferUsages;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC | BufferUsages::INDEX;
        let buffer = self.make(label, size_of_val(triangles).max(12) as u64, usage);
        self.write(&buffer, triangles);
        buffer
    }

    /// A storage buffer with these values; an item of zeros if there are none.
    pub(crate) fn filled<T: Pod>(&self, label: &str, values: &[T]) -> wgpu::Buffer {
        let buffer = self.buffer(label, size_of_val(values).max(size_of::<T>()) as u64);
        self.write(&buffer, values);
        buffer
    }

    /// A uniform buffer with these bytes, that are never changed.
    pub(crate) fn uniform(&self, label: &str, bytes: &[u8]) -> wgpu::Buffer {
        let buffer = self.make(label, bytes.len() as u64, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST);
        self.write(&buffer, bytes);
        buffer
    }

    /// A buffer to map and read.
    pub(crate) fn staging(&self, label: &str, size: u64) -> wgpu::Buffer {
        self.make(label, size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)
    }

    pub(crate) fn make(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let size = size.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        self.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
    }

    /// Writes values at the start of a buffer, before what is submitted next.
    pub(crate) fn write<T: Pod>(&self, buffer: &wgpu::Buffer, values: &[T]) {
        self.queue.write_buffer(buffer, 0, bytemuck::cast_slice(values));
    }

    /// A shader, compiled for each kernel that is made of it.
    #[expect(clippy::unused_self, reason = "a device compiles it")]
    pub(crate) fn module(&self, label: &'static str, source: &'static str) -> Module {
        Module { label, source }
    }

    /// Copies each part to its offset in `staging`, waits, and shows the bytes to `look`.
    pub(crate) fn read<T>(
        &self,
        staging: &wgpu::Buffer,
        parts: &[(&wgpu::Buffer, u64)],
        encoder: wgpu::CommandEncoder,
        look: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, String> {
        self.checked(|| {
            let mut encoder = encoder;
            for &(buffer, offset) in parts {
                encoder.copy_buffer_to_buffer(buffer, 0, staging, offset, buffer.size());
            }
            self.queue.submit([encoder.finish()]);
            let (send, receive) = std::sync::mpsc::channel();
            staging.map_async(wgpu::MapMode::Read, .., move |mapped| {
                // The receiver waits below; if it gave up there is nobody to tell.
                let _ = send.send(mapped);
            });
            self.wait()?;
            receive.recv().map_err(|error| error.to_string())?.map_err(|error| error.to_string())?;
            let seen = staging.get_mapped_range(..).map(|bytes| look(&bytes)).map_err(|error| error.to_string());
            staging.unmap();
            seen
        })
    }

    /// Waits for what was submitted.
    pub(crate) fn wait(&self) -> Result<(), String> {
        let begin = Instant::now();
        while begin.elapsed() < AWAKE {
            if self.poll(wgpu::PollType::Poll)?.is_queue_empty() {
                return Ok(());
            }
            std::thread::yield_now();
        }
        self.poll(wgpu::PollType::wait_indefinitely()).map(drop)
    }

    /// Sees what is done, and calls back whoever asked.
    pub(crate) fn poll(&self, how: wgpu::PollType) -> Result<wgpu::PollStatus, String> {
        // wgpu 30 panics here when the device is lost, where its type says that it returns an error.
        let poll = || self.device.poll(how);
        match std::panic::catch_unwind(std::panic::AssertUnwindSafe(poll)) {
            Ok(polled) => polled.map_err(|error| error.to_string()),
            Err(_) => Err("the device was lost".to_owned()),
        }
    }

    /// An encoder of commands.
    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }
}

/// [`Gpu::checked`], for who has lent the [`Gpu`] to the work: a device is cloned without an allocation.
pub(crate) fn checked<T>(device: &wgpu::Device, work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    let filters = [wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Internal];
    let [validation, memory, internal] = filters.map(|filter| device.push_error_scope(filter));
    let result = work();
    let errors = [pollster::block_on(internal.pop()), pollster::block_on(memory.pop()), pollster::block_on(validation.pop())];
    match errors.into_iter().flatten().next() {
        Some(error) => Err(error.to_string().replace('\n', " ")),
        None => result,
    }
}

/// How a stage sees a buffer.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Bind<'a> {
    Read(&'a wgpu::Buffer),
    Write(&'a wgpu::Buffer),
    Uniform(&'a wgpu::Buffer),
    /// A uniform of this size whose offset is given with each dispatch.
    Dynamic(&'a wgpu::Buffer, u64),
}

impl<'a> Bind<'a> {
    fn entry(self, binding: u32) -> wgpu::BindGroupEntry<'a> {
        let resource = match self {
            Bind::Read(buffer) | Bind::Write(buffer) | Bind::Uniform(buffer) => buffer.as_entire_binding(),
            Bind::Dynamic(buffer, size) => {
                let size = wgpu::BufferSize::new(size);
                wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size })
            }
        };
        wgpu::BindGroupEntry { binding, resource }
    }
}

/// Buffers bound together, and how.
#[derive(Debug)]
pub(crate) struct Group {
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
}

impl Group {
    pub(crate) fn new(gpu: &Gpu, bound: &[(u32, Bind<'_>)]) -> Group {
        let layout_entry = |&(binding, bind): &(u32, Bind<'_>)| {
            use wgpu::BufferBindingType::{Storage, Uniform};
            let (ty, has_dynamic_offset) = match bind {
                Bind::Read(_) => (Storage { read_only: true }, false),
                Bind::Write(_) => (Storage { read_only: false }, false),
                Bind::Uniform(_) => (Uniform, false),
                Bind::Dynamic(..) => (Uniform, true),
            };
            let ty = wgpu::BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None };
            wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None }
        };
        let entries: Vec<_> = bound.iter().map(layout_entry).collect();
        let layout = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
        let layout = gpu.device.create_bind_group_layout(&layout);
        let entries: Vec<_> = bound.iter().map(|&(binding, bind)| bind.entry(binding)).collect();
        let group = wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries };
        Group { group: gpu.device.create_bind_group(&group), layout }
    }

    /// Binds the group as number `index`.
    pub(crate) fn set(&self, pass: &mut wgpu::ComputePass<'_>, index: u32, offsets: &[u32]) {
        pass.set_bind_group(index, &self.group, offsets);
    }
}

/// A shader, by a name that no other has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Module {
    label: &'static str,
    source: &'static str,
}

/// The pipelines of a device, shared by the cloths on it: compiling takes longer than all else that a small cloth needs.
#[derive(Debug, Default)]
struct Pipelines(Mutex<HashMap<Key, wgpu::ComputePipeline>>);

/// Module, entry point, and its constants, by their bits.
type Key = (&'static str, &'static str, Vec<(&'static str, u64)>);

impl Pipelines {
    fn pipeline(&self, device: &wgpu::Device, entry: Entry<'_>, layouts: [&wgpu::BindGroupLayout; 2]) -> wgpu::ComputePipeline {
        let constants = entry.constants.iter().map(|(name, value)| (*name, value.to_bits())).collect();
        let mut made = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let made = made.entry((entry.module.label, entry.name, constants));
        made.or_insert_with(|| {
            let label = Some(entry.module.label);
            let source = wgpu::ShaderSource::Wgsl(entry.module.source.into());
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label, source });
            let bind_group_layouts = &layouts.map(Some);
            let layout = wgpu::PipelineLayoutDescriptor { label: Some(entry.name), bind_group_layouts, immediate_size: 0 };
            let layout = device.create_pipeline_layout(&layout);
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry.name),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(entry.name),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: entry.constants,
                    // No kernel reads what it has not written there.
                    zero_initialize_workgroup_memory: false,
                },
                cache: None,
            })
        })
        .clone()
    }
}

/// A kernel and the buffers it works on. Group 0 is the frame's, group 1 its own: of these it has several alike where the
/// state moves between buffers.
#[derive(Debug)]
pub(crate) struct Stage {
    pipeline: wgpu::ComputePipeline,
    own: Vec<Group>,
}

/// A shader's entry point, and what its overridable constants are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry<'a> {
    pub module: &'a Module,
    pub name: &'static str,
    pub constants: &'a [(&'static str, f64)],
}

impl<'a> Entry<'a> {
    pub(crate) fn new(module: &'a Module, name: &'static str) -> Entry<'a> {
        Entry { module, name, constants: &[] }
    }
}

impl Stage {
    pub(crate) fn new(gpu: &Gpu, frame: &Group, entry: Entry<'_>, bound: &[Vec<(u32, Bind<'_>)>]) -> Stage {
        let own: Vec<Group> = bound.iter().map(|bound| Group::new(gpu, bound)).collect();
        Stage { pipeline: gpu.pipelines.pipeline(&gpu.device, entry, [&frame.layout, &own[0].layout]), own }
    }

    /// Binds other buffers, as many groups and bound alike.
    pub(crate) fn rebind(&mut self, gpu: &Gpu, bound: &[Vec<(u32, Bind<'_>)>]) {
        self.own = bound.iter().map(|bound| Group::new(gpu, bound)).collect();
    }

    /// Runs the kernel on `items` items, with its group number `turn`.
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, turn: usize, offsets: &[u32], items: usize) {
        self.encode_groups(pass, turn, offsets, items.div_ceil(WORKGROUP));
    }

    /// Runs the kernel in this many workgroups.
    pub(crate) fn encode_groups(&self, pass: &mut wgpu::ComputePass<'_>, turn: usize, offsets: &[u32], groups: usize) {
        let rows = groups.div_ceil(MAX_GROUPS).max(1);
        pass.set_pipeline(&self.pipeline);
        self.own[turn].set(pass, 1, offsets);
        pass.dispatch_workgroups(groups.div_ceil(rows) as u32, rows as u32, 1);
    }
}

/// A buffer of values that the CPU writes when they changed; made again when they outgrow it.
#[derive(Debug)]
pub(crate) struct Sent {
    label: &'static str,
    usage: wgpu::BufferUsages,
    pub buffer: wgpu::Buffer,
    bytes: Vec<u8>,
}

impl Sent {
    /// A storage buffer with room for `size` bytes.
    pub(crate) fn storage(gpu: &Gpu, label: &'static str, size: usize) -> Sent {
        Sent::new(gpu, label, size, wgpu::BufferUsages::STORAGE)
    }

    /// A uniform buffer with room for `size` bytes.
    pub(crate) fn uniform(gpu: &Gpu, label: &'static str, size: usize) -> Sent {
        Sent::new(gpu, label, size, wgpu::BufferUsages::UNIFORM)
    }

    fn new(gpu: &Gpu, label: &'static str, size: usize, usage: wgpu::BufferUsages) -> Sent {
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        Sent { label, usage, buffer: gpu.make(label, size as u64, usage), bytes: Vec::with_capacity(size) }
    }

    /// Brings the buffer up to date; true if it had to be made again, and so must be bound again.
    pub(crate) fn send<T: Pod>(&mut self, gpu: &Gpu, values: &[T]) -> bool {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let grown = bytes.len() as u64 > self.buffer.size();
        if grown {
            self.buffer = gpu.make(self.label, bytes.len().next_power_of_two() as u64, self.usage);
        }
        if grown || self.bytes != bytes {
            gpu.queue.write_buffer(&self.buffer, 0, bytes);
            self.bytes.clear();
            self.bytes.extend_from_slice(bytes);
        }
        grown
    }
}
