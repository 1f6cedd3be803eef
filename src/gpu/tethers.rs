//! Tethers in the form that the shaders read: one per vertex, at the end of a table or in a buffer of their own.

use crate::device::Gpu;
use crate::kernels::tether::Tether;
use crate::model::cloth::Cloth;
use crate::step::plan::Plan;

/// Bytes of the tethers of a cloth; 0 without a lone pin.
pub(crate) fn size(cloth: &Cloth) -> usize {
    if cloth.tethers.is_some() { cloth.rest.len() * size_of::<Tether>() } else { 0 }
}

/// Writes the tethers of a plan to a buffer, from byte `at` on. A vertex without one has share 0.
pub(crate) fn send(gpu: &Gpu, plan: &Plan<'_>, buffer: &wgpu::Buffer, at: usize) {
    if plan.coefficients.tethers.is_empty() {
        return;
    }
    let mut all = vec![Tether::default(); plan.cloth.rest.len()];
    plan.coefficients.tethers.iter().for_each(|&(vertex, tether)| all[vertex as usize] = tether);
    gpu.write(buffer, at, &all);
}
