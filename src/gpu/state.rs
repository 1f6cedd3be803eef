//! The cloth's state on the GPU, and how a step moves it between buffers.

use crate::device::{Gpu, Shader};
use crate::gpu::stage::{Bind, BindGroup, Sent, Stage};

/// Positions and displacements, one of each per vertex.
#[derive(Debug, Clone)]
pub(crate) struct StateBuffers {
    /// Positions and inverse masses.
    pub x: wgpu::Buffer,
    /// Last displacements.
    pub p: wgpu::Buffer,
}

/// From which state to which a substep goes: the first from the cloth's own to a copy, the others back and forth
/// between the two copies.
pub(crate) const PING_PONG: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 1]];

/// The index in [`PING_PONG`] of a substep.
pub(crate) fn ping_pong(substep: usize) -> usize {
    if substep == 0 { 0 } else { 2 - substep % 2 }
}

/// The bindings of a stage for each entry of [`PING_PONG`].
pub(crate) fn groups<'a>(
    states: &'a [StateBuffers],
    bound: impl Fn(&'a StateBuffers, &'a StateBuffers) -> Vec<Bind<'a>>,
) -> Vec<Vec<Bind<'a>>> {
    PING_PONG.iter().map(|&[from, to]| bound(&states[from], &states[to])).collect()
}

/// A stage with a bind group for each state.
pub(super) fn stage<'a>(
    gpu: &Gpu,
    uniforms: &BindGroup,
    shader: Shader,
    name: &'static str,
    states: &'a [StateBuffers],
    bound: impl Fn(&'a StateBuffers) -> Vec<Bind<'a>>,
) -> Stage {
    let bound: Vec<_> = states.iter().map(bound).collect();
    Stage::new(gpu, uniforms, shader.entry(name), &bound)
}

/// The bindings of `stages/predict.wgsl`.
pub(super) fn bound_by_predict<'a>(state: &'a StateBuffers, u: &'a wgpu::Buffer, pins: &'a Sent) -> Vec<Bind<'a>> {
    vec![Bind::Read(&state.x), Bind::Read(&state.p), Bind::Write(u), Bind::Read(&pins.buffer)]
}
