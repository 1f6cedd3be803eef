//! A kernel, the buffers it works on, and its dispatch.

use bytemuck::{Pod, Zeroable};

use crate::device::{Entry, Gpu, Pipeline};

/// Invocations per workgroup: `WORKGROUP` of `dispatch.wgsl`.
pub(crate) const WORKGROUP: usize = 64;
/// No index of an edge, label, pin or place: `NONE` of `dispatch.wgsl`.
pub(crate) const NONE: u32 = u32::MAX;
/// Invocations per subgroup, on most devices.
const SUBGROUP: usize = 32;
/// Most workgroups in one dimension of a dispatch.
const MAX_GROUPS: usize = 65_535;
/// Distance (bytes) between slots of a dynamic uniform, and its largest size: the largest alignment that a device may ask for.
pub(crate) const SLOT: usize = 256;

/// A range of items for one dispatch: `Batch` of `dispatch.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Batch {
    pub first: u32,
    pub count: u32,
}

impl From<std::ops::Range<usize>> for Batch {
    fn from(range: std::ops::Range<usize>) -> Batch {
        Batch { first: range.start as u32, count: range.len() as u32 }
    }
}

/// Writes items for [`Bind::Dynamic`] to `bytes`, one per slot.
pub(crate) fn fill_slots<T: Pod>(bytes: &mut Vec<u8>, items: &[T]) {
    bytes.resize(items.len().max(1) * SLOT, 0);
    for (item, bytes) in items.iter().zip(bytes.chunks_mut(SLOT)) {
        bytes[..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(item));
    }
}

/// The offset of slot number `index`.
pub(crate) fn slot(index: usize) -> [u32; 1] {
    [(index * SLOT) as u32]
}

/// A buffer of constant items for [`Bind::Dynamic`].
pub(crate) fn batches(gpu: &Gpu, items: &[Batch]) -> wgpu::Buffer {
    let mut bytes = Vec::new();
    fill_slots(&mut bytes, items);
    let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
    let buffer = gpu.make("batches", bytes.len() as u64, usage);
    gpu.write(&buffer, 0, &bytes);
    buffer
}

/// Invocations of a workgroup: one for each of as many items, in whole subgroups and at least 64, as far as the device allows.
pub(crate) fn lanes(gpu: &Gpu, items: usize) -> usize {
    let limits = gpu.device().limits();
    let allowed = limits.max_compute_invocations_per_workgroup.min(limits.max_compute_workgroup_size_x) as usize;
    items.next_multiple_of(SUBGROUP).clamp(64, 1024).min(allowed)
}

/// How a stage accesses a buffer. Bindings are numbered in the order in which they are listed.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Bind<'a> {
    Read(&'a wgpu::Buffer),
    Write(&'a wgpu::Buffer),
    Uniform(&'a wgpu::Buffer),
    /// A uniform of this size whose offset is given with each dispatch.
    Dynamic(&'a wgpu::Buffer, usize),
    /// A binding of the shader that this entry point does not use.
    Unused,
}

impl<'a> Bind<'a> {
    fn entry(self, binding: u32) -> Option<wgpu::BindGroupEntry<'a>> {
        let resource = match self {
            Bind::Read(buffer) | Bind::Write(buffer) | Bind::Uniform(buffer) => buffer.as_entire_binding(),
            Bind::Dynamic(buffer, size) => {
                let size = wgpu::BufferSize::new(size as u64);
                wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size })
            }
            Bind::Unused => return None,
        };
        Some(wgpu::BindGroupEntry { binding, resource })
    }

    fn layout(self, binding: u32) -> Option<wgpu::BindGroupLayoutEntry> {
        use wgpu::BufferBindingType::{Storage, Uniform};
        let (ty, has_dynamic_offset) = match self {
            Bind::Read(_) => (Storage { read_only: true }, false),
            Bind::Write(_) => (Storage { read_only: false }, false),
            Bind::Uniform(_) => (Uniform, false),
            Bind::Dynamic(..) => (Uniform, true),
            Bind::Unused => return None,
        };
        let ty = wgpu::BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None };
        Some(wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None })
    }
}

/// A bind group and its layout.
#[derive(Debug)]
pub(crate) struct BindGroup {
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
}

impl BindGroup {
    pub(crate) fn new(gpu: &Gpu, bound: &[Bind<'_>]) -> BindGroup {
        let numbered = || bound.iter().zip(0..);
        let entries: Vec<_> = numbered().filter_map(|(bind, number)| bind.layout(number)).collect();
        let layout = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
        let layout = gpu.device().create_bind_group_layout(&layout);
        let entries: Vec<_> = numbered().filter_map(|(bind, number)| bind.entry(number)).collect();
        let group = wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries };
        BindGroup { group: gpu.device().create_bind_group(&group), layout }
    }

    /// Sets the bind group as number `index`.
    pub(crate) fn set(&self, pass: &mut ComputePass, index: u32, offsets: &[u32]) {
        pass.pass.set_bind_group(index, &self.group, offsets);
    }
}

/// A compute pass that counts its dispatches. It must be dropped before its encoder is used again.
pub(crate) struct ComputePass {
    pass: wgpu::ComputePass<'static>,
    pub dispatches: usize,
}

impl ComputePass {
    pub(crate) fn new(encoder: &mut wgpu::CommandEncoder) -> ComputePass {
        let pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()).forget_lifetime();
        ComputePass { pass, dispatches: 0 }
    }
}

/// A kernel and the buffers it works on. Group 0 holds the uniforms that all stages share, group 1 the stage's own
/// buffers. A stage has several groups of the same layout if the state moves between buffers.
#[derive(Debug)]
pub(crate) struct Stage {
    pipeline: Pipeline,
    groups: Vec<BindGroup>,
}

impl Stage {
    pub(crate) fn new(gpu: &Gpu, uniforms: &BindGroup, entry: Entry<'_>, bound: &[Vec<Bind<'_>>]) -> Stage {
        let groups: Vec<BindGroup> = bound.iter().map(|bound| BindGroup::new(gpu, bound)).collect();
        Stage { pipeline: gpu.pipeline(entry, [&uniforms.layout, &groups[0].layout]), groups }
    }

    /// Binds other buffers: as many groups, with the same layout.
    pub(crate) fn rebind(&mut self, gpu: &Gpu, bound: &[Vec<Bind<'_>>]) {
        self.groups = bound.iter().map(|bound| BindGroup::new(gpu, bound)).collect();
    }

    /// Dispatches an invocation for each of `items` items, with the stage's group number `group`.
    pub(crate) fn dispatch(&self, pass: &mut ComputePass, group: usize, offsets: &[u32], items: usize) {
        self.dispatch_workgroups(pass, group, offsets, items.div_ceil(WORKGROUP));
    }

    /// Dispatches this many workgroups.
    pub(crate) fn dispatch_workgroups(&self, pass: &mut ComputePass, group: usize, offsets: &[u32], count: usize) {
        let rows = count.div_ceil(MAX_GROUPS).max(1);
        pass.pass.set_pipeline(self.pipeline.get());
        self.groups[group].set(pass, 1, offsets);
        pass.pass.dispatch_workgroups(count.div_ceil(rows) as u32, rows as u32, 1);
        pass.dispatches += 1;
    }
}

/// A stage that no step contains, with an invocation for each item. It takes all numbers from its buffers.
#[derive(Debug)]
pub(crate) struct SubmittedStage {
    /// Empty: there are no uniforms.
    uniforms: BindGroup,
    stage: Stage,
    items: usize,
}

impl SubmittedStage {
    pub(crate) fn new(gpu: &Gpu, entry: Entry<'_>, bound: Vec<Bind<'_>>, items: usize) -> SubmittedStage {
        let uniforms = BindGroup::new(gpu, &[]);
        let stage = Stage::new(gpu, &uniforms, entry, &[bound]);
        SubmittedStage { uniforms, stage, items }
    }

    /// Submits stages together, each of which waits for the one before.
    pub(crate) fn submit(gpu: &Gpu, stages: &[&SubmittedStage]) {
        let mut encoder = gpu.encoder();
        let mut pass = ComputePass::new(&mut encoder);
        for SubmittedStage { uniforms, stage, items } in stages {
            uniforms.set(&mut pass, 0, &[]);
            stage.dispatch(&mut pass, 0, &[], *items);
        }
        drop(pass);
        gpu.queue().submit([encoder.finish()]);
    }
}

/// A buffer of values that the CPU uploads when they have changed. It is created again if they outgrow it.
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

    /// Updates the buffer. Returns true if it was created again, and thus must be bound again.
    pub(crate) fn send<T: Pod>(&mut self, gpu: &Gpu, values: &[T]) -> bool {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let grown = bytes.len() as u64 > self.buffer.size();
        if grown {
            self.buffer = gpu.make(self.label, bytes.len().next_power_of_two() as u64, self.usage);
        }
        if grown || self.bytes != bytes {
            gpu.write(&self.buffer, 0, bytes);
            self.bytes.clear();
            self.bytes.extend_from_slice(bytes);
        }
        grown
    }
}
