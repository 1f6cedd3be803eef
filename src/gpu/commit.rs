//! The end of a step: the result of its last substep becomes the cloth's state if the stability check finds nothing
//! wrong.

use crate::device::{Entry, Gpu};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, Stage};
use crate::gpu::state::State;
use crate::gpu::watch::Found;
use crate::model::cloth::Cloth;
use crate::step::watch::{LEAST, TURNS};

/// Dispatches of a commit.
pub(crate) const DISPATCHES: usize = 2;

/// The stages that check and commit, with a bind group for each state but the cloth's own.
#[derive(Debug)]
pub(crate) struct Commit {
    /// A [`Found`].
    pub found: wgpu::Buffer,
    check: Stage,
    keep: Stage,
}

impl Commit {
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, forces: &Forces) -> Commit {
        let found = gpu.buffer("found", size_of::<Found>() as u64);
        // An edge without stiffness holds nothing together and is not checked: it is replaced by one from a vertex to
        // itself.
        let ends = cloth.swept().iter().map(|link| if link.stiffness > 0.0 { link.ends } else { [link.ends[0]; 2] });
        let ends = gpu.filled("ends", &ends.collect::<Vec<[u32; 2]>>());
        let (own, made) = (&forces.states[0], &forces.states[1..]);
        let stage = |name, kept: [Bind<'_>; 2]| {
            let bound = made.iter().map(|State { x, p }| {
                let looked_at = if name == "check" { Bind::Read(&ends) } else { Bind::Unused };
                vec![Bind::Read(x), Bind::Read(p), kept[0], kept[1], Bind::Write(&found), looked_at]
            });
            let bound: Vec<_> = bound.collect();
            Stage::new(gpu, &forces.uniforms, Entry { shader: shaders::COMMIT, name, constants: &[] }, &bound)
        };
        let check = stage("check", [Bind::Unused; 2]);
        let keep = stage("commit", [Bind::Write(&own.x), Bind::Write(&own.p)]);
        Commit { found, check, keep }
    }

    /// Resets the result of the check and the number of steps.
    pub(crate) fn begin(&self, gpu: &Gpu) {
        gpu.write(&self.found, 0, &[Found::NOTHING]);
    }

    /// Resets a failure; keeps the number of steps.
    pub(crate) fn go_on(&self, gpu: &Gpu, found: Found) {
        gpu.write(&self.found, 0, &[Found { steps: found.steps, ..Found::NOTHING }]);
    }

    /// Encodes the commit of state number `made`, and its check unless it is already `checked`.
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, made: usize, cloth: &Cloth, checked: bool) {
        let vertices = cloth.rest.len();
        if !checked {
            let edges = cloth.swept().len().div_ceil(TURNS).max(LEAST);
            self.check.dispatch(pass, made - 1, &[], vertices.max(edges));
        }
        self.keep.dispatch(pass, made - 1, &[], vertices);
    }
}
