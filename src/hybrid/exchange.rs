//! Transfers between the CPU and the GPU: the state in one direction, the displacements caused by forces in the other,
//! at three floats per vertex, through two persistent buffers.
//!
//! Both buffers are mapped while the CPU works and are written and read in place ([`Mapped`]). [`Exchange::submit`]
//! hands them to the GPU, and [`Exchange::receive`] waits until they are back. Nothing is copied if the device can use
//! mapped memory directly.
//!
//! Waiting: a driver that sleeps until a fence is signaled wakes 20 us late, half the time of a small exchange; so
//! [`Gpu::wait`] polls for a while first.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{Vec3, Vec4};

use crate::cpu::{MappedVectors, Task};
use crate::device::fault::GpuFault;
use crate::device::{Entry, Gpu};
use crate::gpu::{Bind, ComputePass, Forces, Stage, shaders};
use crate::step::plan::Plan;

/// Size of three floats in bytes.
const THREE: u64 = size_of::<Vec3>() as u64;
/// The value of `ready` when both buffers are mapped.
const BOTH: u32 = 2;
/// Added to `ready` if mapping a buffer was refused.
const REFUSED: u32 = 1 << 16;

/// Which part of the state is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Payload {
    Positions,
    /// Displacements only, from which the device computes the positions.
    Displacements,
    Both,
}

impl Payload {
    const ALL: [Payload; 3] = [Payload::Positions, Payload::Displacements, Payload::Both];

    /// What the forces of `plan` need. `shifts` tells whether positions may change by more than the displacements that
    /// are sent.
    pub(crate) fn needed(plan: &Plan<'_>, shifts: bool) -> Payload {
        match (plan.forces_read_velocities(), shifts) {
            (false, _) => Payload::Positions,
            (true, true) => Payload::Both,
            (true, false) => Payload::Displacements,
        }
    }

    pub(crate) fn has_positions(self) -> bool {
        self != Payload::Displacements
    }

    pub(crate) fn has_displacements(self) -> bool {
        self != Payload::Positions
    }
}

/// The memory that the CPU can access between two exchanges.
pub(crate) struct Mapped {
    /// For writing: the positions (m) of all vertices, followed by their displacements (m).
    outbox: MappedVectors,
    inbox: wgpu::BufferView,
    vertices: usize,
}

impl Mapped {
    /// The displacements (m) caused by the forces, one per vertex.
    pub(crate) fn received(&self) -> &[Vec3] {
        bytemuck::cast_slice(&self.inbox)
    }

    /// Writes the part `what` of a vertex's state, which is at `x` (m) after it moved by `p` (m).
    pub(crate) fn send(&self, task: &Task, what: Payload, vertex: usize, x: Vec4, p: Vec4) {
        let outbox = self.outbox.array().within(task);
        if what.has_positions() {
            outbox.set(vertex, x.truncate());
        }
        if what.has_displacements() {
            outbox.set(self.vertices + vertex, p.truncate());
        }
    }
}

/// The buffers, and the stages that transfer between them and the state on the GPU.
pub(crate) struct Exchange {
    outbox: wgpu::Buffer,
    inbox: wgpu::Buffer,
    /// The copy of `outbox` on the device, if that cannot use the mapped buffer directly.
    sent: Option<wgpu::Buffer>,
    /// The copy of `inbox` on the device, likewise.
    given: Option<wgpu::Buffer>,
    arrive: [Stage; Payload::ALL.len()],
    leave: Stage,
    vertices: u64,
    /// Whether the buffers are mapped, or mapping was requested.
    asked: bool,
    ready: Arc<AtomicU32>,
}

impl Exchange {
    /// For the first state of `forces`. `in_place` says for outbox and inbox whether the device uses the mapped buffer
    /// directly.
    pub(crate) fn new(gpu: &Gpu, forces: &Forces, in_place: [bool; 2]) -> Exchange {
        use wgpu::BufferUsages as Usage;
        let vertices = forces.vertices() as u64;
        let sizes = [2 * THREE * vertices, THREE * vertices];
        let used = |index: usize, copied| if in_place[index] { Usage::STORAGE } else { copied };
        let outbox = gpu.make("outbox", sizes[0], Usage::MAP_WRITE | used(0, Usage::COPY_SRC));
        let inbox = gpu.make("inbox", sizes[1], Usage::MAP_READ | used(1, Usage::COPY_DST));
        let copy = |index: usize, name| (!in_place[index]).then(|| gpu.buffer(name, sizes[index]));
        let copies = [copy(0, "sent"), copy(1, "given")];
        let [sent, given] = [copies[0].as_ref().unwrap_or(&outbox), copies[1].as_ref().unwrap_or(&inbox)];

        let state = &forces.states[0];
        let arrive = Payload::ALL.map(|what| {
            let has = [what.has_positions(), what.has_displacements()].map(f64::from);
            let constants = [("POSITIONS", has[0]), ("DISPLACEMENTS", has[1])];
            let entry = Entry { shader: shaders::EXCHANGE, name: "arrive", constants: &constants };
            let bound = vec![Bind::Read(sent), Bind::Write(&state.x), Bind::Write(&state.p)];
            Stage::new(gpu, &forces.uniforms, entry, &[bound])
        });
        let bound = vec![Bind::Unused, Bind::Unused, Bind::Unused, Bind::Read(&forces.u), Bind::Write(given)];
        let leave = Stage::new(gpu, &forces.uniforms, shaders::EXCHANGE.entry("leave"), &[bound]);
        let [sent, given] = copies;
        Exchange { arrive, leave, vertices, asked: false, ready: Arc::default(), outbox, inbox, sent, given }
    }

    /// Maps the buffers and waits until they are.
    pub(crate) fn open(&mut self, gpu: &Gpu) -> Result<Mapped, GpuFault> {
        self.close();
        self.ask();
        self.receive(gpu)
    }

    /// The commands of an exchange: receive `what`, compute the forces of substep number `index` of `plan`, return the
    /// displacements.
    pub(crate) fn encode(&self, gpu: &Gpu, forces: &Forces, plan: &Plan<'_>, index: usize, what: Payload) -> wgpu::CommandBuffer {
        let mut encoder = gpu.encoder();
        let vertices = self.vertices as usize;
        if let Some(sent) = &self.sent {
            let half = THREE * self.vertices;
            let start = if what.has_positions() { 0 } else { half };
            let end = if what.has_displacements() { 2 * half } else { half };
            encoder.copy_buffer_to_buffer(&self.outbox, start, sent, start, end - start);
        }
        let mut pass = ComputePass::new(&mut encoder);
        forces.bind_substep(&mut pass, index);
        self.arrive[what as usize].dispatch(&mut pass, 0, &[], vertices);
        forces.encode(&mut pass, plan, 0);
        self.leave.dispatch(&mut pass, 0, &[], 3 * vertices);
        drop(pass);
        if let Some(given) = &self.given {
            encoder.copy_buffer_to_buffer(given, 0, &self.inbox, 0, THREE * self.vertices);
        }
        encoder.finish()
    }

    /// Unmaps the buffers, submits the commands, and requests that the buffers be mapped again. Views of them must be
    /// dropped before.
    pub(crate) fn submit(&mut self, gpu: &Gpu, commands: wgpu::CommandBuffer) {
        self.close();
        gpu.queue().submit([commands]);
        self.ask();
    }

    /// Waits until the buffers are mapped again.
    pub(crate) fn receive(&mut self, gpu: &Gpu) -> Result<Mapped, GpuFault> {
        gpu.wait()?;
        gpu.wait_for(|| self.ready.load(Ordering::Acquire) >= BOTH)?;
        if self.ready.load(Ordering::Acquire) != BOTH {
            return Err(gpu.unmapped("its buffers"));
        }
        let outbox = self.outbox.get_mapped_range_mut(..).map_err(GpuFault::other)?;
        let inbox = self.inbox.get_mapped_range(..).map_err(GpuFault::other)?;
        let is_aligned = bytemuck::try_cast_slice::<u8, Vec3>(&inbox).is_ok();
        let outbox = MappedVectors::new(outbox).filter(|_| is_aligned);
        let outbox = outbox.ok_or_else(|| GpuFault::other("the device maps buffers at odd addresses"))?;
        Ok(Mapped { outbox, inbox, vertices: self.vertices as usize })
    }

    fn close(&mut self) {
        if std::mem::take(&mut self.asked) {
            self.outbox.unmap();
            self.inbox.unmap();
        }
    }

    fn ask(&mut self) {
        self.asked = true;
        // A callback of the last mapping may still be pending. It keeps its own counter, and this mapping gets a new
        // one.
        match Arc::get_mut(&mut self.ready) {
            Some(ready) => *ready.get_mut() = 0,
            None => self.ready = Arc::default(),
        }
        let note = || {
            let ready = Arc::clone(&self.ready);
            move |mapped: Result<(), wgpu::BufferAsyncError>| {
                ready.fetch_add(if mapped.is_ok() { 1 } else { REFUSED }, Ordering::Release);
            }
        };
        self.inbox.map_async(wgpu::MapMode::Read, .., note());
        self.outbox.map_async(wgpu::MapMode::Write, .., note());
    }
}
