//! The cloth's state on the GPU, and how a step moves it between buffers.

use crate::gpu::stage::Bind;

/// Positions and displacements, one of each a vertex.
#[derive(Debug, Clone)]
pub(crate) struct State {
    /// Positions and inverse masses.
    pub x: wgpu::Buffer,
    /// Last displacements.
    pub p: wgpu::Buffer,
}

/// From which state to which a substep goes: the first from the cloth's own, then to and fro between the two copies.
pub(crate) const PING_PONG: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 1]];

/// Which of [`PING_PONG`] a substep is.
pub(crate) fn ping_pong(substep: usize) -> usize {
    if substep == 0 { 0 } else { 2 - substep % 2 }
}

/// What a stage binds for each of [`PING_PONG`].
pub(crate) fn groups<'a>(states: &'a [State], bound: impl Fn(&'a State, &'a State) -> Vec<Bind<'a>>) -> Vec<Vec<Bind<'a>>> {
    PING_PONG.iter().map(|&[from, to]| bound(&states[from], &states[to])).collect()
}
