//! The design card's shape: WGSL integrates the forces, the buffer is mapped back, rayon resolves the coloured edges and
//! contact, and the result is written back, every substep. A composition of the other two.

use crate::cloth::Cloth;
use crate::cpu::Cpu;
use crate::engine::Failure;
use crate::gpu::{Forces, Gpu};
use crate::plan::Plan;

/// A cloth whose state is in memory and whose forces are computed on the GPU.
#[derive(Debug)]
pub(crate) struct Hybrid {
    gpu: Gpu,
    forces: Forces,
    staging: wgpu::Buffer,
    pub cpu: Cpu,
}

impl Hybrid {
    pub(crate) fn new(gpu: Gpu, cloth: &Cloth) -> Result<Hybrid, String> {
        gpu.clone().checked(|| {
            let forces = Forces::new(&gpu, cloth, 0)?;
            let staging = gpu.staging("u", forces.u.size());
            Ok(Hybrid { gpu, forces, staging, cpu: Cpu::new(cloth) })
        })
    }

    pub(crate) fn adapter(&self) -> &str {
        &self.gpu.name
    }

    /// One step. Fails, with the state as it was, if the GPU did or the state left the bounds.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        self.cpu.begin();
        match self.substeps(plan) {
            Ok(()) => self.cpu.end(),
            Err(reason) => {
                self.cpu.revert();
                Err(Failure::Gpu(reason))
            }
        }
    }

    fn substeps(&mut self, plan: &Plan<'_>) -> Result<(), String> {
        let Hybrid { gpu, forces, staging, cpu } = self;
        gpu.checked(|| {
            forces.prepare(gpu, plan, false);
            Ok(())
        })?;
        for index in 0..plan.substeps.len() {
            let state = &forces.states[0];
            gpu.write(&state.x, &cpu.x);
            gpu.write(&state.p, &cpu.p);
            let mut encoder = gpu.encoder();
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            forces.set_frame(&mut pass, index);
            forces.encode(&mut pass, plan, 0);
            drop(pass);
            gpu.read(staging, &[(&forces.u, 0)], encoder, |bytes| cpu.p.copy_from_slice(bytemuck::cast_slice(bytes)))?;
            cpu.substeps(plan, index..index + 1);
        }
        Ok(())
    }
}
