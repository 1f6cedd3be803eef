//! Forces for a processor: its state in, their displacements out, three floats a vertex each, through two buffers that stay.
//!
//! Both are mapped while the processor works and written and read in place; [`Exchange::post`] hands them to the GPU and
//! [`Exchange::receive`] waits until they are back. Where the device can use mapped memory as it is, nothing is copied.
//!
//! Waiting: a driver that sleeps until a fence is signalled wakes 20 us late, as long as half a small exchange takes;
//! [`Gpu::wait`] stays awake for a while.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use glam::Vec3;

use crate::cpu::shared::Shared;
use crate::device::{Entry, Gpu};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, Stage};
use crate::step::plan::Plan;

/// How long a callback may take once the device is done.
const PATIENCE: Duration = Duration::from_secs(2);
/// Bytes of three floats.
const THREE: u64 = size_of::<Vec3>() as u64;
/// What `ready` holds when both buffers are back, and what one that was refused adds.
const BOTH: u32 = 2;
const REFUSED: u32 = 1 << 16;

/// What of the state is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parcel {
    Positions,
    /// Positions follow from them.
    Displacements,
    Both,
}

impl Parcel {
    const ALL: [Parcel; 3] = [Parcel::Positions, Parcel::Displacements, Parcel::Both];

    pub(crate) fn has_positions(self) -> bool {
        self != Parcel::Displacements
    }

    pub(crate) fn has_displacements(self) -> bool {
        self != Parcel::Positions
    }
}

/// What the processor can reach between two exchanges; each has as many items as the cloth has vertices.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Desk {
    /// To be written: positions and displacements (m).
    pub x: Shared<Vec3>,
    pub p: Shared<Vec3>,
    /// To be read: displacements (m) by the forces.
    pub u: Shared<Vec3>,
}

/// The buffers, and what moves between them and the state.
#[derive(Debug)]
pub(crate) struct Exchange {
    outbox: wgpu::Buffer,
    inbox: wgpu::Buffer,
    /// The same on the device, where that cannot use a mapped buffer as it is.
    sent: Option<wgpu::Buffer>,
    given: Option<wgpu::Buffer>,
    arrive: Vec<Stage>,
    leave: Stage,
    vertices: u64,
    views: Option<(wgpu::BufferViewMut, wgpu::BufferView)>,
    /// Whether they are mapped, or about to be.
    asked: bool,
    ready: Arc<AtomicU32>,
}

impl Exchange {
    /// For the first state of `forces`; `in_place` says whether the device is to use the mapped outbox and inbox themselves.
    pub(crate) fn new(gpu: &Gpu, forces: &Forces, vertices: usize, in_place: [bool; 2]) -> Exchange {
        use wgpu::BufferUsages as Usage;
        let vertices = vertices as u64;
        let sizes = [2 * THREE * vertices, THREE * vertices];
        let used = |index: usize, copied| if in_place[index] { Usage::STORAGE } else { copied };
        let outbox = gpu.make("outbox", sizes[0], Usage::MAP_WRITE | used(0, Usage::COPY_SRC));
        let inbox = gpu.make("inbox", sizes[1], Usage::MAP_READ | used(1, Usage::COPY_DST));
        let copy = |index: usize, name| (!in_place[index]).then(|| gpu.buffer(name, sizes[index]));
        let copies = [copy(0, "sent"), copy(1, "given")];
        let [sent, given] = [copies[0].as_ref().unwrap_or(&outbox), copies[1].as_ref().unwrap_or(&inbox)];

        let state = &forces.states[0];
        let arrive = Parcel::ALL.map(|parcel| {
            let has = |held: bool| f64::from(u8::from(held));
            let constants = [("POSITIONS", has(parcel.has_positions())), ("DISPLACEMENTS", has(parcel.has_displacements()))];
            let entry = Entry { shader: shaders::EXCHANGE, name: "arrive", constants: &constants };
            let bound = vec![Bind::Read(sent), Bind::Write(&state.x), Bind::Write(&state.p)];
            Stage::new(gpu, &forces.uniforms, entry, &[bound])
        });
        let bound = vec![Bind::Unused, Bind::Unused, Bind::Unused, Bind::Read(&forces.u), Bind::Write(given)];
        let entry = Entry { shader: shaders::EXCHANGE, name: "leave", constants: &[] };
        let leave = Stage::new(gpu, &forces.uniforms, entry, &[bound]);
        let arrive = arrive.into_iter().collect();
        let [sent, given] = copies;
        Exchange { arrive, leave, vertices, views: None, asked: false, ready: Arc::default(), outbox, inbox, sent, given }
    }

    /// What is in reach; maps the buffers if they are not.
    pub(crate) fn open(&mut self, gpu: &Gpu) -> Result<Desk, String> {
        if self.views.is_none() {
            self.close();
            self.ask();
            self.receive(gpu)
        } else {
            self.desk()
        }
    }

    /// The commands of an exchange: `parcel` in, the forces of substep number `index` of `plan`, their displacements out.
    pub(crate) fn encode(
        &self,
        gpu: &Gpu,
        forces: &Forces,
        plan: &Plan<'_>,
        index: usize,
        parcel: Parcel,
    ) -> wgpu::CommandBuffer {
        let mut encoder = gpu.encoder();
        let vertices = self.vertices as usize;
        if let Some(sent) = &self.sent {
            let half = THREE * self.vertices;
            let start = if parcel.has_positions() { 0 } else { half };
            let end = if parcel.has_displacements() { 2 * half } else { half };
            encoder.copy_buffer_to_buffer(&self.outbox, start, sent, start, end - start);
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        forces.bind_substep(&mut pass, index);
        self.arrive[parcel as usize].dispatch(&mut pass, 0, &[], vertices);
        forces.encode(&mut pass, plan, 0);
        self.leave.dispatch(&mut pass, 0, &[], 3 * vertices);
        drop(pass);
        if let Some(given) = &self.given {
            encoder.copy_buffer_to_buffer(given, 0, &self.inbox, 0, THREE * self.vertices);
        }
        encoder.finish()
    }

    /// Hands the buffers over, and asks for them back. What was in reach no longer is.
    pub(crate) fn post(&mut self, gpu: &Gpu, commands: wgpu::CommandBuffer) {
        self.close();
        gpu.queue().submit([commands]);
        self.ask();
    }

    /// Waits until the buffers are back.
    pub(crate) fn receive(&mut self, gpu: &Gpu) -> Result<Desk, String> {
        gpu.wait()?;
        // Another thread that waits for the device may be about to call back for this one.
        let start = Instant::now();
        while self.ready.load(Ordering::Acquire) < BOTH && start.elapsed() < PATIENCE {
            std::thread::yield_now();
            gpu.poll(wgpu::PollType::Poll)?;
        }
        if self.ready.load(Ordering::Acquire) != BOTH {
            return Err("the device could not map its buffers".to_owned());
        }
        let outbox = self.outbox.get_mapped_range_mut(..).map_err(|error| error.to_string())?;
        let inbox = self.inbox.get_mapped_range(..).map_err(|error| error.to_string())?;
        self.views = Some((outbox, inbox));
        self.desk()
    }

    #[expect(clippy::cast_ptr_alignment, reason = "checked below")]
    fn desk(&mut self) -> Result<Desk, String> {
        let Some((outbox, inbox)) = &mut self.views else { return Err("the buffers are away".to_owned()) };
        let vertices = self.vertices as usize;
        let x = outbox.slice(..).as_raw_element_ptr().as_ptr().cast::<Vec3>();
        let u = inbox.as_ptr().cast::<Vec3>().cast_mut();
        if !x.is_aligned() || !u.is_aligned() {
            return Err("the device maps buffers at odd addresses".to_owned());
        }
        // Inside the buffer, which holds two lists.
        let p = x.wrapping_add(vertices);
        Ok(Desk { x: Shared::at(x, vertices), p: Shared::at(p, vertices), u: Shared::at(u, vertices) })
    }

    fn close(&mut self) {
        self.views = None;
        if std::mem::take(&mut self.asked) {
            self.outbox.unmap();
            self.inbox.unmap();
        }
    }

    fn ask(&mut self) {
        self.asked = true;
        self.ready.store(0, Ordering::Release);
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
