//! The end of a step: the result of its last substep becomes the cloth's state if the stability check finds nothing
//! wrong.

use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, ComputePass, Stage};
use crate::gpu::state::{self, StateBuffers};
use crate::gpu::watch::Defects;
use crate::model::cloth::Cloth;
use crate::step::watch::{FEWEST_CHECKED, TURNS};

/// The stages that check and commit, with a bind group for each state but the cloth's own.
pub(crate) struct Commit {
    /// A [`Defects`].
    pub found: wgpu::Buffer,
    /// Made by the first step that needs it, since the last substep of tiles checks the result itself.
    check: Option<Stage>,
    finish: Stage,
}

impl Commit {
    pub(crate) fn new(gpu: &Gpu, forces: &Forces) -> Commit {
        let found = gpu.buffer("found", size_of::<Defects>() as u64);
        let StateBuffers { x, p } = &forces.states[0];
        let finish = stage(gpu, forces, "commit", [Bind::Write(x), Bind::Write(p), Bind::Write(&found), Bind::Unused]);
        Commit { found, check: None, finish }
    }

    /// Prepares for a step whose last substep does not check its result.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, cloth: &Cloth, forces: &Forces) {
        self.check.get_or_insert_with(|| {
            // An edge without stiffness holds nothing together and is not checked: it is replaced by one from a vertex to
            // itself.
            let ends = cloth.swept().iter().map(|link| if cloth.stiffness(link) > 0.0 { link.ends } else { [link.ends[0]; 2] });
            let ends = gpu.filled("ends", &ends.collect::<Vec<[u32; 2]>>());
            stage(gpu, forces, "check", [Bind::Unused, Bind::Unused, Bind::Write(&self.found), Bind::Read(&ends)])
        });
    }

    /// Resets the result of the check, and sets the number of steps.
    pub(crate) fn restart(&self, gpu: &Gpu, steps: u32) {
        gpu.write(&self.found, 0, &[Defects { steps, ..Defects::NOTHING }]);
    }

    /// Waits for the result of the check, and reads it.
    pub(crate) fn read_found(&self, gpu: &Gpu) -> Result<Defects, GpuFault> {
        let staging = gpu.staging("found", self.found.size());
        gpu.read(&staging, &[&self.found], bytemuck::pod_read_unaligned)
    }

    /// Encodes the commit of state number `made`, and its check unless it is already `checked`.
    pub(crate) fn encode(&self, pass: &mut ComputePass, made: usize, cloth: &Cloth, checked: bool) {
        let vertices = cloth.rest.len();
        if let (false, Some(check)) = (checked, &self.check) {
            let edges = cloth.swept().len().div_ceil(TURNS).max(FEWEST_CHECKED);
            check.dispatch(pass, made - 1, &[], vertices.max(edges));
        }
        self.finish.dispatch(pass, made - 1, &[], vertices);
    }
}

/// A kernel of a commit, bound to each state but the cloth's own.
fn stage(gpu: &Gpu, forces: &Forces, name: &'static str, others: [Bind<'_>; 4]) -> Stage {
    let [a, b, c, d] = others;
    state::stage(gpu, &forces.uniforms, shaders::COMMIT, name, &forces.states[1..], |StateBuffers { x, p }| {
        vec![Bind::Read(x), Bind::Read(p), a, b, c, d]
    })
}
