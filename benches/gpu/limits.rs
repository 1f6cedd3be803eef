//! What the device can achieve at best, measured by minimal kernels: the limits that times are compared with.

use std::time::{Duration, Instant};

use cloth_deformer::{Deformer, Gpu, wgpu};

use crate::Failure;

/// Number of dependent dispatches, and of colors within a dispatch, that are timed.
const CHAIN: [u32; 2] = [256, 1024];
/// Number of workgroups that fill a large device; those of `limits.wgsl` have [`EDGES`] invocations with an edge each.
const FULL: u32 = 2112;
const EDGES: u32 = 256;
/// The same for `--quick`, for a software device.
const FEW: u32 = 16;
/// Number of tries, and the longest time that they take.
const TRIES: usize = 30;
const PATIENCE: Duration = Duration::from_secs(1);
/// Number of bytes copied.
const COPIED: u64 = 256 << 20;

/// The limits of a device.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// A dispatch that waits for the one before, reads an index, reads what it refers to, and writes (s); no dispatch
    /// of a step does less.
    dispatch: f64,
    /// A color that waits for the one before, in workgroup memory: read two vertices, correct them, write, barrier (s).
    round: f64,
    /// An edge among as many as the device processes at once, in the same way (s).
    edge: f64,
    /// A byte read or written in a copy (s).
    byte: f64,
}

impl Limits {
    pub(crate) fn new(gpu: &Gpu, quick: bool) -> Result<Limits, Failure> {
        let full = if quick { FEW } else { FULL };
        let bench = Bench::new(gpu);
        let dispatch = bench.dispatch()?;
        let round = bench.rounds(1)?;
        let edge = bench.rounds(full)? / f64::from(full * EDGES);
        let limits = Limits { dispatch, round, edge, byte: bench.byte()? };
        println!("\n| limit | measured |\n|---|---|");
        println!("| a dispatch that reads what the previous one wrote | {:.2} us |", dispatch * 1e6);
        println!("| a color in workgroup memory, of {EDGES} edges | {:.3} us |", round * 1e6);
        println!("| edges in workgroup memory, {full} workgroups at once | {:.1} G/s |", 1e-9 / edge);
        println!("| copy of {} MiB, read and write | {:.0} GB/s |", COPIED >> 20, 1e-9 / limits.byte);
        Ok(limits)
    }

    /// The limit for the last step (ms): all of its dispatches in sequence, the colors within them in sequence or all
    /// edges at the device's throughput, whichever takes longer, and all bytes. Also the parts.
    pub(crate) fn of(&self, cloth: &Deformer) -> Option<[f64; 4]> {
        let stats = cloth.gpu_stats()?;
        let dispatches = stats.dispatches as f64 * self.dispatch;
        let rounds = (stats.rounds as f64 * self.round).max(stats.edges as f64 * self.edge);
        let bytes = stats.bytes as f64 * self.byte;
        Some([dispatches + rounds + bytes, dispatches, rounds, bytes].map(|seconds| 1e3 * seconds))
    }
}

struct Bench<'a> {
    gpu: &'a Gpu,
    chain: wgpu::ComputePipeline,
    colors: wgpu::ComputePipeline,
    copy: wgpu::ComputePipeline,
}

impl Bench<'_> {
    fn new(gpu: &Gpu) -> Bench<'_> {
        let source = concat!(include_str!("../../shaders/distance.wgsl"), include_str!("limits.wgsl"));
        let source = wgpu::ShaderSource::Wgsl(source.into());
        let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let [chain, colors, copy] = ["chain", "colors", "copy"].map(|entry| {
            gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: None,
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        });
        Bench { gpu, chain, colors, copy }
    }

    fn storage(&self, size: u64) -> wgpu::Buffer {
        use wgpu::BufferUsages;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        self.gpu.device().create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    }

    fn group(&self, pipeline: &wgpu::ComputePipeline, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let buffers = buffers.iter().enumerate();
        let entries = buffers.map(|(binding, buffer)| (binding as u32, buffer.as_entire_binding()));
        let entries: Vec<_> = entries.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let layout = &pipeline.get_bind_group_layout(0);
        self.gpu.device().create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    /// How much longer (s) `work` takes with the second of two counts than with the first, per unit: the least of
    /// several tries, because a limit is what nothing disturbs.
    fn slope(&self, numbers: [u32; 2], work: impl Fn(&mut wgpu::CommandEncoder, u32)) -> Result<f64, Failure> {
        let mut least = [f64::INFINITY; 2];
        let begin = Instant::now();
        for _ in (0..TRIES).take_while(|&tries| tries == 0 || begin.elapsed() < PATIENCE) {
            for (least, number) in least.iter_mut().zip(numbers) {
                let mut encoder = self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                work(&mut encoder, number);
                let commands = encoder.finish();
                let begin = Instant::now();
                self.gpu.queue().submit([commands]);
                self.gpu.device().poll(wgpu::PollType::wait_indefinitely())?;
                *least = least.min(begin.elapsed().as_secs_f64());
            }
        }
        Ok((least[1] - least[0]) / f64::from(numbers[1] - numbers[0]))
    }

    fn dispatch(&self) -> Result<f64, Failure> {
        let [indices, a, b] = [1024; 3].map(|size| self.storage(size));
        let turns = [[&indices, &a, &b], [&indices, &b, &a]].map(|buffers| self.group(&self.chain, &buffers));
        self.slope(CHAIN, |encoder, count| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.chain);
            for turn in turns.iter().cycle().take(count as usize) {
                pass.set_bind_group(0, turn, &[]);
                pass.dispatch_workgroups(1, 1, 1);
            }
        })
    }

    fn rounds(&self, workgroups: u32) -> Result<f64, Failure> {
        let group = |count: u32| {
            let (numbers, out) = (self.storage(16), self.storage(u64::from(workgroups) * 16));
            self.gpu.queue().write_buffer(&numbers, 0, &count.to_le_bytes());
            self.group(&self.colors, &[&numbers, &out])
        };
        let groups = CHAIN.map(group);
        self.slope(CHAIN, |encoder, count| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.colors);
            pass.set_bind_group(0, &groups[usize::from(count == CHAIN[1])], &[]);
            pass.dispatch_workgroups(workgroups, 1, 1);
        })
    }

    fn byte(&self) -> Result<f64, Failure> {
        let limits = self.gpu.device().limits();
        let size = COPIED.min(limits.max_storage_buffer_binding_size);
        let [from, to] = [size; 2].map(|size| self.storage(size));
        let turns = [[&from, &to], [&to, &from]].map(|buffers| self.group(&self.copy, &buffers));
        let copy = self.slope([2, 10], |encoder, count| {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.copy);
            for turn in turns.iter().cycle().take(count as usize) {
                pass.set_bind_group(0, turn, &[]);
                // Four vectors per invocation.
                pass.dispatch_workgroups((size / (16 * 4 * u64::from(EDGES))) as u32, 1, 1);
            }
        })?;
        Ok(copy / (2.0 * size as f64))
    }
}
