//! The end of a step: what its last substep made becomes the cloth's state if all of it is within bounds.

use crate::device::{Entry, Gpu};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, Stage};
use crate::gpu::state::State;

/// What `first_bad` is while every vertex is within bounds: `NONE` of `limits.wgsl`.
pub(crate) const NONE: u32 = u32::MAX;
/// Dispatches of a commit.
pub(crate) const DISPATCHES: usize = 2;

/// The stages that check and commit, with a group for each state but the cloth's own.
#[derive(Debug)]
pub(crate) struct Commit {
    /// The first vertex that is out of bounds, or [`NONE`].
    pub first_bad: wgpu::Buffer,
    check: Stage,
    keep: Stage,
}

impl Commit {
    pub(crate) fn new(gpu: &Gpu, forces: &Forces) -> Commit {
        let first_bad = gpu.buffer("first_bad", 4);
        let (own, made) = (&forces.states[0], &forces.states[1..]);
        let stage = |name, kept: [Bind<'_>; 2]| {
            let bound =
                made.iter().map(|State { x, p }| vec![Bind::Read(x), Bind::Read(p), kept[0], kept[1], Bind::Write(&first_bad)]);
            let bound: Vec<_> = bound.collect();
            Stage::new(gpu, &forces.uniforms, Entry { shader: shaders::COMMIT, name, constants: &[] }, &bound)
        };
        let check = stage("check", [Bind::Unused; 2]);
        let keep = stage("commit", [Bind::Write(&own.x), Bind::Write(&own.p)]);
        Commit { first_bad, check, keep }
    }

    /// Forgets what was out of bounds.
    pub(crate) fn clear(&self, gpu: &Gpu) {
        gpu.write(&self.first_bad, 0, &[NONE]);
    }

    /// Encodes the commit of state number `made`.
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, made: usize, vertices: usize) {
        self.check.dispatch(pass, made - 1, &[], vertices);
        self.keep.dispatch(pass, made - 1, &[], vertices);
    }
}
