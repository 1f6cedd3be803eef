//! The start of a substep: the prediction, and the forces that the scene has. An absent force has no kernel and no
//! buffer.

use glam::Vec4;

use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::gpu::bending::{Bending, BendingInputs, MOMENTS};
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, BindGroup, ComputePass, SLOT, Sent, Stage, fill_slots, slot};
use crate::gpu::state::{StateBuffers, bound_by_predict, stage};
use crate::kernels::integrate::Pin;
use crate::kernels::params::{Params, Substep};
use crate::model::cloth::Cloth;
use crate::options::Method;
use crate::step::plan::Plan;

/// The buffers of the states and the force kernels. Each kernel can start from any of the states.
pub(crate) struct Forces {
    /// The cloth's own state, and those that the substeps of a step write in turn.
    pub states: Vec<StateBuffers>,
    /// Displacements of the current substep.
    pub u: wgpu::Buffer,
    /// [`Params`] and the current [`Substep`].
    pub uniforms: BindGroup,
    params: Sent,
    substeps: Sent,
    /// The substeps in the form in which they are uploaded.
    slots: Vec<u8>,
    /// The same substeps without gaps, for kernels that read all of them.
    pub all_substeps: Sent,
    pub pins: Sent,
    predict: Stage,
    /// Whether bending may run in tiles; tests switch it off.
    pub bend_in_tiles: bool,
    pub(super) bending: Option<Bending>,
    wind: Option<Stage>,
    springs: Option<Stage>,
}

impl Forces {
    /// Creates this many states in addition to the cloth's own, which may exist already.
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, copies: usize, own: Option<StateBuffers>) -> Result<Forces, GpuFault> {
        let size = size_of_val(cloth.rest.as_slice()) as u64;
        // The largest of the buffers that the cloth may need later: bending moments of several passes, springs, panels.
        gpu.meets(
            "the cloth's largest buffer",
            (MOMENTS[1] * size).max(24 * cloth.links.len() as u64).max(16 * cloth.triangles.len() as u64),
        )?;
        let u = gpu.buffer("u", size);
        let own = own.unwrap_or_else(|| {
            let x = gpu.buffer_for("x", size, wgpu::BufferUsages::VERTEX);
            StateBuffers { x, p: gpu.buffer("p", size) }
        });
        let mut states = vec![own];
        states
            .extend((0..copies).map(|_| StateBuffers { x: gpu.buffer("x of a copy", size), p: gpu.buffer("p of a copy", size) }));
        let params = Sent::uniform(gpu, "params", size_of::<Params>());
        let substeps = Sent::uniform(gpu, "substeps", SLOT);
        let all_substeps = Sent::storage(gpu, "all substeps", size_of::<Substep>());
        let uniforms = uniforms(gpu, &params, &substeps);
        let pins = Sent::storage(gpu, "pins", cloth.pinned.len().max(1) * size_of::<Pin>());
        let predict = stage(gpu, &uniforms, shaders::PREDICT, "predict", &states, |state| bound_by_predict(state, &u, &pins));
        let (bending, wind, springs) = (None, None, None);
        Ok(Forces {
            states,
            u,
            uniforms,
            params,
            substeps,
            slots: Vec::new(),
            all_substeps,
            pins,
            predict,
            bend_in_tiles: true,
            bending,
            wind,
            springs,
        })
    }

    /// Number of vertices.
    pub(crate) fn vertices(&self) -> usize {
        self.u.size() as usize / size_of::<Vec4>()
    }

    /// Uploads the data of this step. Unless one dispatch does `all` of the step, also creates the kernels that it is the first to
    /// need, which write to the `averages` of the finest level if there are levels. Returns true if [`Forces::all_substeps`] has
    /// become another buffer.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>, all: bool, averages: Option<&wgpu::Buffer>) -> bool {
        let Forces { states, u, uniforms, params, substeps, slots, all_substeps, pins, bend_in_tiles, .. } = self;
        params.send(gpu, std::slice::from_ref(&plan.params));
        pins.send(gpu, plan.pins);
        if all {
            return all_substeps.send(gpu, plan.substeps);
        }
        fill_slots(slots, plan.substeps);
        if substeps.send(gpu, slots) {
            *uniforms = self::uniforms(gpu, params, substeps);
        }
        if plan.bending {
            // Wind and pins that follow targets move vertices after bending.
            let last = !plan.air && plan.pins.is_empty();
            let level = plan.levels.first().zip(averages).filter(|_| last && plan.params.levels > 0);
            let bound = BendingInputs { states, u, uniforms, pins, level };
            self.bending.get_or_insert_with(|| Bending::new(gpu, plan)).prepare(gpu, plan, bound, *bend_in_tiles);
        }
        if plan.air {
            self.wind.get_or_insert_with(|| {
                let triangles = plan.cloth.panels();
                let panels = gpu.filled("panels", &triangles.panels);
                let spans = gpu.filled("panel spans", &triangles.around.spans);
                let around = gpu.filled("panels around", &triangles.around.items);
                stage(gpu, uniforms, shaders::WIND, "wind", states, |state| {
                    let [panels, spans, around, x, p] = [&panels, &spans, &around, &state.x, &state.p].map(Bind::Read);
                    vec![panels, spans, around, x, p, Bind::Write(u)]
                })
            });
        }
        if plan.method == Method::Springs {
            self.springs.get_or_insert_with(|| {
                let at = plan.cloth.springs();
                let (springs, spans) = (gpu.filled("springs", &at.items), gpu.filled("spring spans", &at.spans));
                stage(gpu, uniforms, shaders::SPRINGS, "springs", states, |state| {
                    vec![Bind::Read(&springs), Bind::Read(&spans), Bind::Read(&state.x), Bind::Write(u)]
                })
            });
        }
        false
    }

    /// Makes the next step create the springs again.
    pub(crate) fn forget_springs(&mut self) {
        self.springs = None;
    }

    /// Binds the parameters of one substep for the stages encoded next.
    pub(crate) fn bind_substep(&self, pass: &mut ComputePass, substep: usize) {
        self.uniforms.set(pass, 0, &slot(substep));
    }

    /// Whether the forces of a substep include the averages of its finest level.
    pub(crate) fn averages(&self, plan: &Plan<'_>) -> bool {
        plan.params.levels > 0 && self.bending.as_ref().is_some_and(|bending| plan.bending && bending.averages())
    }

    /// Encodes the forces of one substep that starts from state number `from`.
    pub(crate) fn encode(&self, pass: &mut ComputePass, plan: &Plan<'_>, from: usize) {
        let vertices = plan.cloth.rest.len();
        match self.bending.as_ref().filter(|_| plan.bending) {
            None => self.predict.dispatch(pass, from, &[], vertices + plan.pins.len()),
            Some(bending) => bending.encode(pass, plan, from),
        }
        if let Some(wind) = self.wind.as_ref().filter(|_| plan.air) {
            wind.dispatch(pass, from, &[], vertices);
        }
        if let Some(springs) = self.springs.as_ref().filter(|_| plan.method == Method::Springs) {
            springs.dispatch(pass, from, &[], vertices);
        }
    }
}

/// The bindings that all stages share: [`Params`], and the [`Substep`] that [`Forces::bind_substep`] selects.
fn uniforms(gpu: &Gpu, params: &Sent, substeps: &Sent) -> BindGroup {
    BindGroup::new(gpu, &[Bind::Uniform(&params.buffer), Bind::Dynamic(&substeps.buffer, size_of::<Substep>())])
}
