//! The bare transfer: bytes up, a kernel that does nothing, as many bytes back. It uses no code of the crate.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use cloth_deformer::{Gpu, wgpu};

use crate::median;

/// A way to transfer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Way {
    /// `Queue::write_buffer`, a copy to a buffer that is then mapped, and a wait that sleeps.
    Written,
    /// Persistent mapped buffers that are copied from and to, and a wait that sleeps.
    Copied,
    /// The same with polling instead of sleeping.
    CopiedPolled,
    /// The same, but the kernel reads directly from the mapped buffer.
    HalfCopied,
}

impl Way {
    pub(crate) const ALL: [Way; 4] = [Way::Written, Way::Copied, Way::CopiedPolled, Way::HalfCopied];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Way::Written => "write_buffer, sleep",
            Way::Copied => "mapped, sleep",
            Way::CopiedPolled => "mapped, poll",
            Way::HalfCopied => "mapped, copied down alone, poll",
        }
    }

    fn polls(self) -> bool {
        matches!(self, Way::CopiedPolled | Way::HalfCopied)
    }
}

/// Median time (s) of an exchange of `bytes` in each direction.
pub(crate) fn floor(gpu: &Gpu, way: Way, bytes: u64) -> f64 {
    if way == Way::HalfCopied && !gpu.device().features().contains(wgpu::Features::MAPPABLE_PRIMARY_BUFFERS) {
        return f64::INFINITY;
    }
    let link = Link::new(gpu, way, bytes);
    let data = vec![1_u8; bytes as usize];
    let start = Instant::now();
    let mut times = Vec::new();
    while times.len() < 200 && (times.len() < 20 || start.elapsed().as_secs_f64() < 0.5) {
        let start = Instant::now();
        link.exchange(&data);
        times.push(start.elapsed().as_secs_f64());
    }
    median(&mut times)
}

struct Link<'a> {
    gpu: &'a Gpu,
    way: Way,
    /// In each direction, the buffer that the CPU maps and the one on the device.
    up: [wgpu::Buffer; 2],
    down: [wgpu::Buffer; 2],
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    ready: Arc<AtomicU32>,
}

const NOTHING: &str = "
@group(0) @binding(0) var<storage, read> up: array<u32>;
@group(0) @binding(1) var<storage, read_write> down: array<u32>;
@compute @workgroup_size(1) fn nothing() { down[0] = up[0]; }
";

impl<'a> Link<'a> {
    fn new(gpu: &'a Gpu, way: Way, bytes: u64) -> Link<'a> {
        use wgpu::BufferUsages as Usage;
        let make = |usage| {
            let descriptor = wgpu::BufferDescriptor { label: None, size: bytes, usage, mapped_at_creation: false };
            gpu.device().create_buffer(&descriptor)
        };
        let primary = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let down = [make(Usage::MAP_READ | Usage::COPY_DST), make(primary)];
        let up = if way == Way::HalfCopied {
            let up = make(Usage::STORAGE | Usage::MAP_WRITE);
            [up.clone(), up]
        } else {
            [make(Usage::MAP_WRITE | Usage::COPY_SRC), make(primary)]
        };
        let module = gpu
            .device()
            .create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source: wgpu::ShaderSource::Wgsl(NOTHING.into()) });
        let pipeline = gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: up[1].as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: down[1].as_entire_binding() },
            ],
        });
        let link = Link { gpu, way, up, down, pipeline, group, ready: Arc::default() };
        if way != Way::Written {
            link.ask(false);
            link.wait();
        }
        link
    }

    fn exchange(&self, data: &[u8]) {
        let bytes = data.len() as u64;
        let mut encoder = self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        if self.way == Way::Written {
            self.gpu.queue().write_buffer(&self.up[1], 0, data);
        } else {
            self.fill(data);
            self.up[0].unmap();
        }
        if matches!(self.way, Way::Copied | Way::CopiedPolled) {
            encoder.copy_buffer_to_buffer(&self.up[0], 0, &self.up[1], 0, bytes);
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&self.down[1], 0, &self.down[0], 0, bytes);
        self.gpu.queue().submit([encoder.finish()]);
        self.ask(true);
        self.wait();
        let seen = self.down[0].get_mapped_range(..).expect("it was mapped");
        assert!(seen[0] == 1, "what went up comes back");
        drop(seen);
        self.down[0].unmap();
    }

    /// Writes the bytes to their destination, with all threads where that pays.
    fn fill(&self, data: &[u8]) {
        const SHARE: usize = 1 << 17;
        let put = |index: usize, share: &[u8]| {
            let start = (index * SHARE) as u64;
            let mut view = self.up[0].get_mapped_range_mut(start..start + share.len() as u64).expect("it was mapped");
            view.copy_from_slice(share);
        };
        if data.len() <= SHARE {
            return put(0, data);
        }
        rayon::scope(|scope| {
            data.chunks(SHARE).enumerate().for_each(|(index, share)| scope.spawn(move |_| put(index, share)));
        });
    }

    /// Requests that the buffer of returned bytes (if `back`) and the one for the next bytes be mapped.
    fn ask(&self, back: bool) {
        self.ready.store(0, Ordering::Release);
        let note = || {
            let ready = Arc::clone(&self.ready);
            move |mapped: Result<(), wgpu::BufferAsyncError>| {
                mapped.expect("buffers can be mapped");
                ready.fetch_add(1, Ordering::Release);
            }
        };
        for (buffer, mode, wanted) in
            [(&self.down[0], wgpu::MapMode::Read, back), (&self.up[0], wgpu::MapMode::Write, self.way != Way::Written)]
        {
            if wanted {
                buffer.map_async(mode, .., note());
            } else {
                self.ready.fetch_add(1, Ordering::Release);
            }
        }
    }

    fn wait(&self) {
        while self.ready.load(Ordering::Acquire) < 2 {
            let how = if self.way.polls() { wgpu::PollType::Poll } else { wgpu::PollType::wait_indefinitely() };
            self.gpu.device().poll(how).expect("the device is there");
        }
    }
}
