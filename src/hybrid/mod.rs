//! The design card's shape: WGSL integrates the forces, buffers are mapped back, threads resolve the coloured edges and contact.
//! A composition of the other two.
//!
//! # Theory
//! The GPU turns what the CPU sends, positions or displacements, into the displacement that the forces cause in a substep;
//! the CPU adds it to what carries over from the last substep, sweeps the edges and moves the vertices. Only forces that
//! differ from vertex to vertex need a GPU: a scene without bending, wind and springs exchanges nothing.
//!
//! # Practice
//! An exchange is a round of the CPU's own ([`Elsewhere`]), taken by one thread while the others look on. Tasks write what is
//! sent into mapped memory as they move their vertices, and read what comes back where it lies: see
//! [`Exchange`]. While the GPU works its next commands are encoded. Sent is what the terms need: positions for bending and
//! springs, displacements for air and damped bending, from which the GPU keeps the positions itself; both where contact moves a
//! vertex besides.
//!
//! # How often
//! Every substep, if at all. Half a second of a square metre of 65 x 65 vertices at 20 substeps (`cargo bench --bench hybrid`
//! on an H200), the forces held for as many substeps as an exchange is made to be good for: RMS distance from 640 substeps on
//! the CPU (m), and milliseconds a frame.
//!
//! | an exchange every | 1 | 2 | 4 | 10 | 20 |
//! |---|---|---|---|---|---|
//! | gravity alone | .0060, 0.57 | the same: there is none | | | |
//! | bending, 1e-4 N m | .0050, 1.8 | .012, 1.3 | .044, 0.96 | .24, 0.85 | .26, 0.72 |
//! | wind, 5 m/s | .037, 1.5 | .037, 1.0 | .037, 0.57 | .038, 0.39 | .044, 0.32 |
//! | a towel in it, damped | .016, 1.9 | .018, 1.3 | .045, 0.96 | .068, 0.87 | .059, 0.64 |
//!
//! Bending that is held acts late, which gives energy: from 2 on the sheet shivers. Wind alone could be held for half a frame
//! without being farther from the truth than 20 substeps are, but it moves the cloth by .004 m (2) to .024 m (20) from where
//! the other backends have it; so it is not. The figures, and how near an exchange is to the bare transfer, are in
//! `benches/results/hybrid_h200.csv`.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use glam::{Vec3A, Vec4};

use crate::backend::Failure;
use crate::cpu::shared::Shared;
use crate::cpu::{Cpu, Elsewhere, State};
use crate::device::Gpu;
use crate::gpu::{Desk, Exchange, Forces, Parcel};
use crate::kernels::{self, Params, Substep, xyz};
use crate::model::cloth::Cloth;
use crate::options::Method;
use crate::step::plan::Plan;

/// A cloth whose state is in memory and whose forces are computed on the GPU.
#[derive(Debug)]
pub(crate) struct Hybrid {
    gpu: Gpu,
    forces: Forces,
    exchange: Exchange,
    /// What was sent ahead of the next step.
    sent: Option<Parcel>,
    /// Substeps that each exchange is good for.
    pub every: usize,
    /// What the GPU is told of the substeps, one an exchange.
    told: Vec<Substep>,
    pub cpu: Cpu,
}

/// An exchange at work: by one thread at a time.
struct Post<'a> {
    gpu: &'a Gpu,
    forces: &'a Forces,
    exchange: &'a mut Exchange,
    next: Option<wgpu::CommandBuffer>,
    /// Why there are no more.
    failed: Option<String>,
}

/// Whether a step has forces that differ from vertex to vertex.
fn gathers(plan: &Plan<'_>) -> bool {
    plan.bending || plan.wind || plan.method == Method::Springs
}

impl Hybrid {
    pub(crate) fn new(gpu: Gpu, cloth: &Cloth) -> Result<Hybrid, String> {
        gpu.clone().checked(|| {
            let forces = Forces::new(&gpu, cloth, 0)?;
            // The inverse masses; the rest of it is sent.
            gpu.write(&forces.states[0].x, 0, &cloth.rest);
            let in_place = gpu.device().features().contains(wgpu::Features::MAPPABLE_PRIMARY_BUFFERS);
            let exchange = Exchange::new(&gpu, &forces, cloth.rest.len(), [in_place; 2]);
            Ok(Hybrid { gpu, forces, exchange, sent: None, every: 1, told: Vec::new(), cpu: Cpu::new(cloth) })
        })
    }

    pub(crate) fn adapter(&self) -> &str {
        self.gpu.name()
    }

    /// Puts the state somewhere else.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        self.sent = None;
        self.cpu.set(x, p);
    }

    /// One step. Fails, with the state as it was, if the GPU did or the state left the bounds.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        let sent = self.sent.take();
        if !gathers(plan) {
            return self.cpu.step(plan);
        }
        self.sent = Some(self.exchanged(plan, sent)?);
        Ok(())
    }

    /// Whether the device uses the mapped outbox and inbox themselves.
    pub(crate) fn exchange_in_place(&mut self, vertices: usize, in_place: [bool; 2]) {
        self.exchange = Exchange::new(&self.gpu, &self.forces, vertices, in_place);
        self.sent = None;
    }

    /// Runs the kernels of a substep's forces this often, and waits.
    pub(crate) fn run_forces(&mut self, plan: &Plan<'_>, repeats: u32) -> Result<(), String> {
        let Hybrid { gpu, forces, .. } = self;
        gpu.checked(|| {
            forces.prepare(gpu, plan, false);
            let mut encoder = gpu.encoder();
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            forces.bind_substep(&mut pass, 0);
            (0..repeats).for_each(|_| forces.encode(&mut pass, plan, 0));
            drop(pass);
            gpu.queue().submit([encoder.finish()]);
            gpu.wait()
        })
    }

    /// A step whose start was sent ahead, or was not. Returns what was sent ahead of the next.
    #[expect(unsafe_code, reason = "tasks touch their own vertices alone (see Moves), the desk is on loan between exchanges")]
    fn exchanged(&mut self, plan: &Plan<'_>, sent: Option<Parcel>) -> Result<Parcel, Failure> {
        let Hybrid { gpu, forces, exchange, every, told, cpu, .. } = self;
        let (every, count) = ((*every).clamp(1, plan.substeps.len()), plan.substeps.len());
        // Forces alone: what carries over is the CPU's, and so are the pins.
        told.clear();
        told.extend(plan.substeps.chunks(every).map(|run| {
            let gain = run.iter().map(|substep| substep.gain).sum();
            Substep { carry: 0.0, gain, ..run[0] }
        }));
        let alone = Plan { params: Params { pins: 0, ..plan.params }, substeps: told, pins: &[], ..*plan };

        let moving = plan.wind || plan.bending && plan.damped();
        let parcel = |whole: bool| match (moving, whole || every > 1 || !plan.bodies.is_empty()) {
            (false, _) => Parcel::Positions,
            (true, true) => Parcel::Both,
            (true, false) => Parcel::Displacements,
        };
        let whole = parcel(true);
        let first = gpu.checked(|| {
            forces.prepare(gpu, &alone, false);
            let desk = exchange.open(gpu)?;
            Ok((desk, exchange.encode(gpu, forces, &alone, 0, whole)))
        });
        let (mut desk, next) = first.map(|(desk, next)| ([Some(desk)], Some(next))).map_err(Failure::Gpu)?;
        if sent != Some(whole) {
            desk.iter().flatten().for_each(|desk| put_all(desk, cpu));
        }
        let desk = Shared::new(&mut desk);
        let post = Mutex::new(Post { gpu, forces, exchange, next, failed: None });
        let fetch = |substep: usize| {
            if substep.is_multiple_of(every) {
                let post = &mut *post.lock().unwrap_or_else(PoisonError::into_inner);
                let next = substep / every + 1;
                let next = (next < alone.substeps.len()).then_some((next, parcel(false)));
                // SAFETY: this is its round's only task.
                unsafe { desk.set(0, post.exchange(&alone, next)) };
            }
        };
        let predict = |vertices: &[Range<u32>], substep: usize, state: State| {
            // SAFETY: only `fetch` writes there, in another round; an index is a vertex of the cloth.
            unsafe {
                let Some(desk) = desk.get(0) else { return };
                let (gain, whole) = (plan.substeps[substep].gain, alone.substeps[substep / every].gain);
                let scale = if gain == whole { 1.0 } else { gain / whole };
                for i in vertices.iter().flat_map(|range| range.start as usize..range.end as usize) {
                    let free = state.x.get(i).w > 0.0;
                    let carried = kernels::predict(xyz(state.u.get(i)), Vec3A::ZERO, &plan.substeps[substep]);
                    let by = carried + Vec3A::from(desk.u.get(i)) * scale;
                    state.u.set(i, if free { by.extend(0.0) } else { Vec4::ZERO });
                }
            }
        };
        let moved = |vertices: &[Range<u32>], substep: usize, state: State| {
            let last = substep + 1 == count;
            if !last && !(substep + 1).is_multiple_of(every) {
                return;
            }
            // SAFETY: as above.
            unsafe {
                let Some(desk) = desk.get(0) else { return };
                for i in vertices.iter().flat_map(|range| range.start as usize..range.end as usize) {
                    put(&desk, parcel(last), i, state.x.get(i), state.u.get(i));
                }
            }
        };
        let stepped = cpu.step_with(plan, Some(&Elsewhere { exchange: &fetch, predict: &predict, moved: &moved }));
        match post.into_inner().unwrap_or_else(PoisonError::into_inner).failed {
            None => stepped.map(|()| whole),
            Some(reason) => {
                cpu.revert();
                Err(Failure::Gpu(reason))
            }
        }
    }
}

impl Post<'_> {
    /// One exchange; meanwhile the next is encoded. No desk if it failed.
    fn exchange(&mut self, plan: &Plan<'_>, next: Option<(usize, Parcel)>) -> Option<Desk> {
        let Post { gpu, forces, exchange, .. } = self;
        let commands = self.next.take()?;
        let done = gpu.checked(|| {
            exchange.post(gpu, commands);
            self.next = next.map(|(index, parcel)| exchange.encode(gpu, forces, plan, index, parcel));
            exchange.receive(gpu)
        });
        done.map_err(|reason| (self.next, self.failed) = (None, Some(reason))).ok()
    }
}

/// Sends the whole state.
#[expect(unsafe_code, reason = "one thread, and both lists are as long as the desk's")]
fn put_all(desk: &Desk, cpu: &Cpu) {
    for (i, (&x, &p)) in cpu.x.iter().zip(cpu.p.iter()).enumerate() {
        // SAFETY: nobody else is here.
        unsafe { put(desk, Parcel::Both, i, x, p) };
    }
}

/// Sends a vertex.
///
/// # Safety
/// That of [`Shared::set`], for the desk.
#[expect(unsafe_code, reason = "see the safety section")]
unsafe fn put(desk: &Desk, parcel: Parcel, i: usize, x: Vec4, p: Vec4) {
    // SAFETY: the caller's promise.
    unsafe {
        if parcel.has_positions() {
            desk.x.set(i, x.truncate());
        }
        if parcel.has_displacements() {
            desk.p.set(i, p.truncate());
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use crate::{Attributes, Backend, Collider, Deformer, Fabric, Mesh, Options, Quality};

    /// The same bits wherever the device reads and writes, whatever of the state is sent; and that is the CPU's motion.
    #[test]
    fn memory_in_place_or_copied_gives_the_same_motion() {
        let mesh = Mesh::grid(21, 17, 1.0, 0.8);
        let ball = vec![Collider::sphere(Vec3::new(0.0, -0.2, 0.0), 0.19)];
        for (bending, air_density, colliders) in [(1e-4, 0.0, vec![]), (0.0, 1.2, vec![]), (1e-4, 1.2, ball)] {
            let attributes = Attributes { wind: Vec3::new(3.0, 1.0, 2.0), air_density, colliders, ..Attributes::default() };
            let run = |backend, in_place: Option<[bool; 2]>| {
                let fabric = Fabric { bending, damping: if air_density > 0.0 { 0.05 } else { 0.0 }, ..Fabric::default() };
                let quality = Quality::Substeps(12);
                let options = Options { backend, fabric, quality, pinned: vec![0, 20], ..Options::default() };
                let mut deformer = Deformer::new(&mesh, options).unwrap();
                in_place.into_iter().for_each(|in_place| deformer.exchange_in_place(in_place));
                for _ in 0..5 {
                    deformer.step(1.0 / 60.0, &attributes).unwrap();
                }
                deformer.positions().unwrap().to_vec()
            };
            let copied = run(Backend::Hybrid, Some([false; 2]));
            assert!(copied == run(Backend::Hybrid, None));
            let cpu = run(Backend::Cpu, None);
            let rms = |a: &[Vec3], b: &[Vec3]| {
                (a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum::<f32>() / a.len() as f32).sqrt()
            };
            let (apart, moved) = (rms(&copied, &cpu), rms(&cpu, &mesh.positions));
            assert!(moved > 0.01 && apart <= 1e-4 * moved, "{apart} m apart of {moved}");
        }
    }
}
