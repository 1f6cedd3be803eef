//! Milliseconds per frame, by wall-clock time and by the device's timestamps.

use std::time::{Duration, Instant};

use cloth_deformer::{Attributes, Deformer, Gpu, wgpu};

use crate::Failure;
use crate::hang::FRAME;

/// Time of work before the first figure: clock rates rise, memory is touched, pipelines are compiled. A GPU that was idle takes seconds
/// to raise its rate again; an H200 is four times slower until then.
const WARM: Duration = Duration::from_millis(500);
const WARM_GPU: Duration = Duration::from_secs(2);
/// Time that the frames of a figure take, and their minimum and maximum number.
const SPAN: Duration = Duration::from_millis(400);
const LEAST: usize = 3;
const MOST: usize = 200;
/// Number of frames queued at once, for the figures of a full queue, and for frames longer than [`LONG`] (ms).
const QUEUED: [u32; 2] = [8, 2];
const LONG: f64 = 20.0;

/// Medians of milliseconds per frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Times {
    /// From the call to the end of the work, waiting for each frame; nothing is read back.
    pub(crate) frame: f64,
    /// With frames queued without waiting, as a renderer does.
    pub(crate) queued: f64,
    /// Queued, by the device's timestamps.
    pub(crate) device: Option<f64>,
}

/// Steps some cloths together, frame by frame, and times that.
pub(crate) fn time(cloths: &mut [Deformer], attributes: &Attributes, clock: Option<&DeviceClock>) -> Result<Times, Failure> {
    let (begin, span) = (Instant::now(), if clock.is_some() { WARM_GPU } else { WARM });
    let mut warm = 0;
    while warm < 2 || begin.elapsed() < span {
        step(cloths, attributes)?;
        wait(cloths)?;
        warm += 1;
    }
    let frame = median(|| {
        let begin = Instant::now();
        step(cloths, attributes)?;
        wait(cloths)?;
        Ok(begin.elapsed())
    })?;
    let count = QUEUED[usize::from(frame > LONG)];
    let queued = median(|| {
        let begin = Instant::now();
        for _ in 0..count {
            step(cloths, attributes)?;
        }
        wait(cloths)?;
        Ok(begin.elapsed() / count)
    })?;
    let device = match clock {
        Some(clock) => Some(median(|| {
            // The frame ahead keeps the device busy while the first one that counts is being encoded.
            step(cloths, attributes)?;
            clock.mark(0);
            for _ in 0..count {
                step(cloths, attributes)?;
            }
            clock.mark(1);
            Ok(clock.elapsed()? / count)
        })?),
        None => None,
    };
    Ok(Times { frame, queued, device })
}

/// A frame of every cloth, submitted together.
fn step(cloths: &mut [Deformer], attributes: &Attributes) -> Result<(), Failure> {
    match cloths {
        [alone] => drop(alone.step(FRAME, attributes)?),
        crowd => {
            let stepped = Deformer::step_all(crowd.iter_mut().map(|cloth| (cloth, attributes)), FRAME);
            stepped.into_iter().try_for_each(|step| step.map(drop))?;
        }
    }
    Ok(())
}

/// All share a queue, so the last one is done when all are.
fn wait(cloths: &[Deformer]) -> Result<(), Failure> {
    Ok(cloths.last().map_or(Ok(()), Deformer::wait)?)
}

/// The median (ms).
fn median(mut once: impl FnMut() -> Result<Duration, Failure>) -> Result<f64, Failure> {
    let begin = Instant::now();
    let mut times = Vec::new();
    while times.len() < LEAST || begin.elapsed() < SPAN && times.len() < MOST {
        times.push(once()?);
    }
    times.sort_unstable();
    Ok(times[times.len() / 2].as_secs_f64() * 1e3)
}

/// The device's timestamps, read between submissions.
#[derive(Debug)]
pub(crate) struct DeviceClock {
    gpu: Gpu,
    marks: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
}

impl DeviceClock {
    /// `None` if the device has no timestamps.
    pub(crate) fn new(gpu: &Gpu) -> Option<DeviceClock> {
        if !gpu.device().features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let marks = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: 2 };
        let buffer = |usage| {
            gpu.device().create_buffer(&wgpu::BufferDescriptor { label: None, size: 16, usage, mapped_at_creation: false })
        };
        let resolved = buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC);
        let staging = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        Some(DeviceClock { marks: gpu.device().create_query_set(&marks), gpu: gpu.clone(), resolved, staging })
    }

    /// Records the time after everything submitted so far, by a pass that does nothing else.
    fn mark(&self, index: u32) {
        let mut encoder = self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        drop(encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                query_set: &self.marks,
                beginning_of_pass_write_index: None,
                end_of_pass_write_index: Some(index),
            }),
        }));
        self.gpu.queue().submit([encoder.finish()]);
    }

    /// The time from the first mark to the second; waits for it.
    fn elapsed(&self) -> Result<Duration, Failure> {
        let mut encoder = self.gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.resolve_query_set(&self.marks, 0..2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.staging, 0, 16);
        self.gpu.queue().submit([encoder.finish()]);
        self.staging.map_async(wgpu::MapMode::Read, .., |_| {});
        self.gpu.device().poll(wgpu::PollType::wait_indefinitely())?;
        let ticks: [u64; 2] = bytemuck::pod_read_unaligned(&self.staging.get_mapped_range(..)?);
        self.staging.unmap();
        let ticks = ticks[1].saturating_sub(ticks[0]);
        Ok(Duration::from_secs_f64(ticks as f64 * f64::from(self.gpu.queue().get_timestamp_period()) * 1e-9))
    }
}
