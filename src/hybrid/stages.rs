//! What the hybrid engine does in the stages of the CPU's substeps.

use std::ops::Range;
use std::sync::{Mutex, PoisonError, RwLock};

use glam::{Vec3A, Vec4};

use crate::cpu::{ExternalPrediction, StateView, Task};
use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::gpu::Forces;
use crate::hybrid::exchange::{Exchange, Mapped, Payload};
use crate::kernels::integrate::{predict_displacement, xyz};
use crate::step::plan::Plan;

/// A step with exchanges, which the CPU's tasks share.
pub(super) struct ExchangedStep<'a> {
    pub plan: &'a Plan<'a>,
    /// The step as the GPU sees it.
    pub on_gpu: &'a Plan<'a>,
    /// What is sent between two exchanges of the step.
    pub payload: Payload,
    /// What is sent at the step's start and end.
    pub complete: Payload,
    /// Whether the state at the step's start is already in the outbox.
    pub is_sent: bool,
    /// The mapped buffers, or none while the GPU has them. Only [`ExchangedStep::exchange`] changes this, and no other
    /// task runs during it, so nobody ever waits for the lock.
    pub mapped: RwLock<Option<Mapped>>,
    pub exchanges: Mutex<Exchanges<'a>>,
}

/// The exchanges of a step, which one thread at a time runs.
pub(super) struct Exchanges<'a> {
    pub gpu: &'a Gpu,
    pub forces: &'a Forces,
    pub exchange: &'a mut Exchange,
    /// The encoded commands of the next exchange.
    pub next: Option<wgpu::CommandBuffer>,
    /// Why exchanging failed, if it did.
    pub failed: Option<GpuFault>,
}

impl ExternalPrediction for ExchangedStep<'_> {
    /// Exchanges the state for the displacements that the forces cause.
    fn exchange(&self, task: &Task, state: StateView<'_>, substep: usize) {
        if substep == 0 && !self.is_sent {
            self.send(task, Payload::Both, state, 0..self.plan.cloth.rest.len());
        }
        let next = (substep + 1 < self.plan.substeps.len()).then_some((substep + 1, self.payload));
        let mut mapped = self.mapped.write().unwrap_or_else(PoisonError::into_inner);
        // The device gets the buffers only once nothing views them.
        *mapped = None;
        *mapped = self.exchanges.lock().unwrap_or_else(PoisonError::into_inner).exchange(self.on_gpu, next);
    }

    /// What carries over, and what the forces cause.
    fn predict(&self, state: StateView<'_>, vertices: Range<u32>, substep: usize) {
        let carry = Vec3A::splat(self.plan.substeps[substep].carry);
        let mapped = self.mapped.read().unwrap_or_else(PoisonError::into_inner);
        let Some(mapped) = &*mapped else { return };
        let vertices = vertices.start as usize..vertices.end as usize;
        for (i, &received) in vertices.clone().zip(&mapped.received()[vertices]) {
            let free = state.x.get(i).w > 0.0;
            let carried = predict_displacement(xyz(state.u.get(i)), carry, Vec3A::ZERO);
            let by = carried + Vec3A::from(received);
            state.u.set(i, if free { by.extend(0.0) } else { Vec4::ZERO });
        }
    }

    /// Sends their state.
    fn moved(&self, task: &Task, state: StateView<'_>, vertices: &[Range<u32>], substep: usize) {
        let is_last = substep + 1 == self.plan.substeps.len();
        let payload = if is_last { self.complete } else { self.payload };
        self.send(task, payload, state, vertices.iter().flat_map(|range| range.start as usize..range.end as usize));
    }
}

impl ExchangedStep<'_> {
    /// Sends a part of the state of vertices.
    fn send(&self, task: &Task, what: Payload, StateView { x, u }: StateView<'_>, vertices: impl Iterator<Item = usize>) {
        if let Some(to) = &*self.mapped.read().unwrap_or_else(PoisonError::into_inner) {
            vertices.for_each(|vertex| to.send(task, what, vertex, x.get(vertex), u.get(vertex)));
        }
    }

    /// The mapped buffers after the step, or why exchanging failed.
    pub(super) fn finish(self) -> Result<Option<Mapped>, GpuFault> {
        match self.exchanges.into_inner().unwrap_or_else(PoisonError::into_inner).failed {
            None => Ok(self.mapped.into_inner().unwrap_or_else(PoisonError::into_inner)),
            Some(reason) => Err(reason),
        }
    }
}

impl Exchanges<'_> {
    /// Runs one exchange and encodes the next one meanwhile. On failure nothing is mapped.
    fn exchange(&mut self, plan: &Plan<'_>, next: Option<(usize, Payload)>) -> Option<Mapped> {
        let Exchanges { gpu, forces, exchange, .. } = self;
        let commands = self.next.take()?;
        let done = gpu.checked(|| {
            exchange.submit(gpu, commands);
            self.next = next.map(|(index, payload)| exchange.encode(gpu, forces, plan, index, payload));
            exchange.receive(gpu)
        });
        done.map_err(|reason| (self.next, self.failed) = (None, Some(reason))).ok()
    }
}
