//! One dispatch per color, and one for contact: for any mesh and any number of sweeps. The other sweeps are tested
//! against it.

use crate::device::Gpu;
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Batch, Bind, ComputePass, Sent, Stage, batches, slot};
use crate::gpu::state::groups;
use crate::gpu::tethers;
use crate::kernels::distance::Edge;
use crate::model::cloth::Cloth;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;

/// Sweeps with one dispatch per color.
pub(crate) struct PerColor {
    colors: Vec<Batch>,
    edges: wgpu::Buffer,
    /// The tethers, if there are any.
    tethers: Option<wgpu::Buffer>,
    /// The substep that edges and tethers are computed for.
    length: Option<Length>,
    project: Stage,
    contact: Stage,
}

impl PerColor {
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, forces: &Forces, bodies: &Sent) -> PerColor {
        let colors: Vec<Batch> = cloth.visits().into_iter().map(Batch::from).collect();
        let edges = gpu.buffer("edges", (cloth.swept().len().max(1) * size_of::<Edge>()) as u64);
        let slots = batches(gpu, &colors);
        let bound = groups(&forces.states, |from, _| {
            vec![Bind::Dynamic(&slots, size_of::<Batch>()), Bind::Read(&edges), Bind::Read(&from.x), Bind::Write(&forces.u)]
        });
        let project = Stage::new(gpu, &forces.uniforms, shaders::PROJECT.entry("project"), &bound);
        let size = tethers::size(cloth);
        let tethers = (size > 0).then(|| gpu.buffer("tethers", size as u64));
        let bound = PerColor::bound_by_contact(forces, bodies, tethers.as_ref());
        let contact = Stage::new(gpu, &forces.uniforms, shaders::CONTACT.entry("contact"), &bound);
        PerColor { colors, edges, tethers, length: None, project, contact }
    }

    fn bound_by_contact<'a>(forces: &'a Forces, bodies: &'a Sent, tethers: Option<&'a wgpu::Buffer>) -> Vec<Vec<Bind<'a>>> {
        groups(&forces.states, |from, to| {
            let read = [&from.x, &forces.u, &bodies.buffer].map(Bind::Read);
            // Without tethers another buffer is bound, which is not read.
            let tethers = Bind::Read(tethers.unwrap_or(&forces.u));
            [&read[..], &[Bind::Write(&to.x), Bind::Write(&to.p), tethers]].concat()
        })
    }

    pub(crate) fn rebind(&mut self, gpu: &Gpu, forces: &Forces, bodies: &Sent) {
        self.contact.rebind(gpu, &PerColor::bound_by_contact(forces, bodies, self.tethers.as_ref()));
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        if self.length != Some(plan.coefficients.length) && plan.params.sweeps > 0 {
            gpu.write(&self.edges, 0, &plan.coefficients.edges);
            self.tethers.iter().for_each(|buffer| tethers::send(gpu, plan, buffer, 0));
            self.length = Some(plan.coefficients.length);
        }
    }

    /// Encodes the sweeps and contact of a substep, number `group` of [`crate::gpu::state::PING_PONG`].
    pub(crate) fn encode(&self, pass: &mut ComputePass, plan: &Plan<'_>, group: usize) {
        for _ in 0..plan.params.sweeps {
            for (color, batch) in self.colors.iter().enumerate() {
                self.project.dispatch(pass, group, &slot(color), batch.count as usize);
            }
        }
        self.contact.dispatch(pass, group, &[], plan.cloth.rest.len());
    }
}
