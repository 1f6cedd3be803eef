//! Buffers of the device, and the limits that they must keep.

use bytemuck::Pod;

use crate::device::Gpu;
use crate::device::fault::{GpuFault, Need};

/// A [`Need`] that a field of [`wgpu::Limits`] limits.
macro_rules! need {
    ($limits:ident, $thing:literal, $needed:expr, $limit:ident) => {
        Need { thing: $thing, needed: $needed, limit: stringify!($limit), allowed: u64::from($limits.$limit) }
    };
}

impl Gpu {
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
        if self.is_lost() {
            return Err(GpuFault::Lost);
        }
        let limits = self.device().limits();
        let (limit, allowed) = self.most_bytes();
        // What wgpu's defaults allow in any case, in the words of its limits.
        allows(&[
            Need { thing, needed: bytes, limit, allowed },
            need!(limits, "uniforms", 4096, max_uniform_buffer_binding_size),
            need!(limits, "storage buffers of a stage", 8, max_storage_buffers_per_shader_stage),
            need!(limits, "uniform buffers of a stage", 3, max_uniform_buffers_per_shader_stage),
            need!(limits, "uniform buffers with an offset", 2, max_dynamic_uniform_buffers_per_pipeline_layout),
            need!(limits, "bind groups", 2, max_bind_groups),
            need!(limits, "bindings of a group", 18, max_bindings_per_bind_group),
            need!(limits, "workgroups", 65_535, max_compute_workgroups_per_dimension),
        ])?;
        self.has_threads(64)
    }

    /// Fails if a workgroup cannot have so many threads.
    pub(crate) fn has_threads(&self, needed: usize) -> Result<(), GpuFault> {
        let limits = self.device().limits();
        allows(&[
            need!(limits, "threads of a workgroup", needed as u64, max_compute_invocations_per_workgroup),
            need!(limits, "threads of a workgroup", needed as u64, max_compute_workgroup_size_x),
        ])
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
        let (limit, allowed) = if usage.contains(wgpu::BufferUsages::STORAGE) {
            self.most_bytes()
        } else {
            ("max_buffer_size", self.device().limits().max_buffer_size)
        };
        if size > allowed {
            Gpu::refuse(Need { thing: label, needed: size, limit, allowed });
        }
        let size = if size > allowed { wgpu::COPY_BUFFER_ALIGNMENT } else { size };
        self.device().create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
    }

    /// Writes values at byte `start` of a buffer, ahead of the next submission.
    pub(crate) fn write<T: Pod>(&self, buffer: &wgpu::Buffer, start: usize, values: &[T]) {
        self.queue().write_buffer(buffer, start as u64, bytemuck::cast_slice(values));
    }
}

/// Fails if more is needed of a thing than its limit allows.
fn allows(needs: &[Need]) -> Result<(), GpuFault> {
    needs.iter().find(|need| need.needed > need.allowed).map_or(Ok(()), |&need| Err(GpuFault::Limit(need)))
}
