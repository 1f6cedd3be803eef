//! The hybrid engine: forces on the GPU, edges and contact on the CPU. It is composed of the two other engines.
//!
//! # Theory
//! The CPU sends positions or displacements. The GPU computes from them the displacement that the forces cause in a
//! substep. The CPU adds it to what carries over from the last substep, sweeps the edges and moves the vertices. Only
//! forces that differ from vertex to vertex need a GPU: a scene without bending, wind and springs exchanges nothing.
//!
//! # Practice
//! An exchange is a stage of the CPU's substep ([`ExternalPrediction`](crate::cpu::ExternalPrediction)), run by one
//! thread while the others wait. Tasks write what is sent into mapped memory as they move their vertices, and read the
//! results from mapped memory: see [`Exchange`]. While the GPU works, its next commands are encoded. What is sent depends on the forces: positions for
//! bending and springs; displacements for air and damped bending, from which the GPU updates its positions; both if
//! contact also shifts positions.
//!
//! # How often
//! Every substep, if at all. Forces that are held for several substeps act late, which adds energy: bent sheets shiver from two
//! on. Wind could be held for half a frame, but then moves the cloth by .004 to .024 m from where the other engines have it
//! (`benches/results/hybrid.md`).

mod exchange;
mod stages;

use std::sync::{Mutex, RwLock};

use crate::cpu::Cpu;
use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::error::failure::Failure;
#[cfg(feature = "bench")]
use crate::gpu::ComputePass;
use crate::gpu::Forces;
use crate::hybrid::exchange::{Exchange, Mapped, Payload};
use crate::hybrid::stages::{ExchangedStep, Exchanges};
use crate::kernels::params::{Params, Substep};
use crate::model::cloth::{Change, Cloth};
use crate::step::plan::Plan;

/// A cloth whose state is in the CPU's memory and whose forces are computed on the GPU.
pub(crate) struct Hybrid {
    pub gpu: Gpu,
    forces: Forces,
    exchange: Exchange,
    /// The mapped buffers between steps.
    mapped: Option<Mapped>,
    /// Which part of the next step's initial state was written to them already.
    sent: Option<Payload>,
    /// The substeps as the GPU sees them. It computes only the displacements that the forces cause; the CPU adds what carries over.
    forces_alone: Vec<Substep>,
    /// Why preparing a step failed. The objects built halfway must not be used by another step.
    broken: Option<GpuFault>,
    pub cpu: Cpu,
}

impl Hybrid {
    pub(crate) fn new(gpu: Gpu, cloth: &Cloth) -> Result<Hybrid, GpuFault> {
        gpu.clone().checked(|| {
            let forces = Forces::new(&gpu, cloth, 0, None)?;
            // Provides the inverse masses; positions are sent.
            gpu.write(&forces.states[0].x, 0, &cloth.rest);
            let in_place = gpu.device().features().contains(wgpu::Features::MAPPABLE_PRIMARY_BUFFERS);
            let exchange = Exchange::new(&gpu, &forces, [in_place; 2]);
            Ok(Hybrid {
                gpu,
                forces,
                exchange,
                mapped: None,
                sent: None,
                forces_alone: Vec::new(),
                broken: None,
                cpu: Cpu::new(cloth),
            })
        })
    }

    /// The cloth on the CPU, to be changed: the next step sends its state anew.
    pub(crate) fn cpu_mut(&mut self) -> &mut Cpu {
        self.sent = None;
        &mut self.cpu
    }

    /// Continues with changed parameters of the cloth.
    pub(crate) fn change(&mut self, cloth: &Cloth, change: Change, state: [&[glam::Vec4]; 2]) -> Result<(), GpuFault> {
        if change == Change::Stiffness {
            self.forces.forget_springs();
            return Ok(());
        }
        let mut made = Hybrid::new(self.gpu.clone(), cloth)?;
        std::mem::swap(&mut made.cpu, &mut self.cpu);
        *self = made;
        self.cpu.change(change, state);
        Ok(())
    }

    /// Runs one step. If the GPU fails or the motion is unstable, it returns the failure and restores the state.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        let sent = self.sent.take();
        if !plan.has_forces() {
            return self.cpu.step(plan, None);
        }
        self.broken.clone().map_or(Ok(()), |fault| Err(Failure::Gpu(fault)))?;
        self.sent = Some(self.exchanged(plan, sent)?);
        Ok(())
    }

    /// Chooses whether the device uses the mapped outbox and inbox directly.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn exchange_in_place(&mut self, in_place: [bool; 2]) {
        self.mapped = None;
        self.exchange = Exchange::new(&self.gpu, &self.forces, in_place);
        self.sent = None;
    }

    /// Runs the force kernels of a substep `repeats` times and waits for them.
    #[cfg(feature = "bench")]
    pub(crate) fn run_forces(&mut self, plan: &Plan<'_>, repeats: u32) -> Result<(), GpuFault> {
        let Hybrid { gpu, forces, .. } = self;
        gpu.checked(|| {
            forces.prepare(gpu, plan, false, None);
            let mut encoder = gpu.encoder();
            let mut pass = ComputePass::new(&mut encoder);
            forces.bind_substep(&mut pass, 0);
            (0..repeats).for_each(|_| forces.encode(&mut pass, plan, 0));
            drop(pass);
            gpu.queue().submit([encoder.finish()]);
            gpu.wait()
        })
    }

    /// Runs a step with exchanges. `sent` is the part of its initial state that was already sent. Returns the part of
    /// the next step's that was.
    fn exchanged(&mut self, plan: &Plan<'_>, sent: Option<Payload>) -> Result<Payload, Failure> {
        let Hybrid { gpu, forces, exchange, mapped, forces_alone, broken, cpu, .. } = self;
        forces_alone.clear();
        forces_alone.extend(plan.substeps.iter().map(|substep| Substep { carry: 0.0, ..*substep }));
        // The CPU moves the pins.
        let on_gpu = &Plan { params: Params { pins: 0, ..plan.params }, substeps: forces_alone, pins: &[], ..*plan };
        let complete = Payload::needed(plan, true);
        // Besides displacements, colliders and contact change positions.
        let payload = Payload::needed(plan, !plan.bodies.is_empty() || plan.has_contact());

        let is_sent = sent == Some(complete);
        let opened = gpu.checked(|| {
            forces.prepare(gpu, on_gpu, false, None);
            Gpu::refused()?;
            // If the device was destroyed meanwhile, its memory is gone, so it is mapped again before anything is written.
            let mapped = match mapped.take().filter(|_| is_sent) {
                Some(mapped) => mapped,
                None => exchange.open(gpu)?,
            };
            Ok((mapped, exchange.encode(gpu, forces, on_gpu, 0, complete)))
        });
        let (first, next) = opened.inspect_err(|fault| *broken = Some(fault.clone()))?;

        let step = ExchangedStep {
            plan,
            on_gpu,
            payload,
            complete,
            is_sent,
            mapped: RwLock::new(Some(first)),
            exchanges: Mutex::new(Exchanges { gpu, forces, exchange, next: Some(next), failed: None }),
        };
        let stepped = cpu.step(plan, Some(&step));
        *mapped = step.finish().map_err(|reason| {
            cpu.roll_back();
            Failure::Gpu(reason)
        })?;
        stepped.map(|()| complete)
    }
}

#[cfg(test)]
#[path = "../../tests/unit/hybrid.rs"]
mod tests;
