//! The time of the shortest dispatch, with which times are compared.

use std::time::{Duration, Instant};

use cloth_deformer::{Deformer, Gpu, wgpu};

use crate::Failure;

/// Numbers of dependent dispatches that are timed.
const CHAIN: [u32; 2] = [256, 1024];
/// Number of tries, and the longest time that they take.
const TRIES: usize = 30;
const PATIENCE: Duration = Duration::from_secs(1);
/// Bytes of the buffers.
const SIZE: u64 = 1024;

/// The time (s) of a dispatch that waits for the one before, reads an index, reads what it refers to, and writes. No dispatch of
/// a step does less.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limit(f64);

impl Limit {
    pub(crate) fn new(gpu: &Gpu) -> Result<Limit, Failure> {
        let limit = shortest(gpu)?;
        println!("\nA dispatch that reads what the previous one wrote takes {:.2} us.", limit * 1e6);
        Ok(Limit(limit))
    }

    /// The time (ms) of as many dispatches as in the last step.
    pub(crate) fn of(self, cloth: &Deformer) -> Option<f64> {
        cloth.dispatches().map(|dispatches| 1e3 * dispatches as f64 * self.0)
    }
}

/// How much longer (s) the longer chain takes per dispatch: the least of several tries, because a limit is what nothing
/// disturbs.
fn shortest(gpu: &Gpu) -> Result<f64, Failure> {
    let device = gpu.device();
    let source = wgpu::ShaderSource::Wgsl(include_str!("chain.wgsl").into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let chain = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("chain"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let usage = wgpu::BufferUsages::STORAGE;
    let [indices, a, b] = [(); 3]
        .map(|()| device.create_buffer(&wgpu::BufferDescriptor { label: None, size: SIZE, usage, mapped_at_creation: false }));
    let turns = [[&indices, &a, &b], [&indices, &b, &a]].map(|buffers| {
        let entries = [0, 1, 2].map(|k| wgpu::BindGroupEntry { binding: k as u32, resource: buffers[k].as_entire_binding() });
        let layout = &chain.get_bind_group_layout(0);
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    });
    let mut least = [f64::INFINITY; 2];
    let begin = Instant::now();
    for _ in (0..TRIES).take_while(|&tries| tries == 0 || begin.elapsed() < PATIENCE) {
        for (least, count) in least.iter_mut().zip(CHAIN) {
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&chain);
            for turn in turns.iter().cycle().take(count as usize) {
                pass.set_bind_group(0, turn, &[]);
                pass.dispatch_workgroups(1, 1, 1);
            }
            drop(pass);
            let commands = encoder.finish();
            let begin = Instant::now();
            gpu.queue().submit([commands]);
            device.poll(wgpu::PollType::wait_indefinitely())?;
            *least = least.min(begin.elapsed().as_secs_f64());
        }
    }
    Ok((least[1] - least[0]) / f64::from(CHAIN[1] - CHAIN[0]))
}
