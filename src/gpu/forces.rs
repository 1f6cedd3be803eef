//! Stage 1 on the GPU: the state, and the forces that the scene has. A term that is absent has no kernel and no buffer.

use crate::kernels::{Params, Pin, Substep};
use crate::model::cloth::Cloth;
use crate::options::Method;
use crate::step::plan::Plan;

use super::SLOT;
use super::device::{Bind, Entry, Gpu, Group, Sent, Stage, shader};

/// A state of the cloth on the GPU.
#[derive(Debug)]
pub(crate) struct State {
    /// Positions and inverse masses.
    pub x: wgpu::Buffer,
    /// Last displacements.
    pub p: wgpu::Buffer,
}

/// The states' buffers and the force kernels. Each kernel can take any of the states.
#[derive(Debug)]
pub(crate) struct Forces {
    /// The cloth's own, and those that the substeps of a step make in turn.
    pub states: Vec<State>,
    /// Displacements in the making.
    pub u: wgpu::Buffer,
    /// [`Params`] and the [`Substep`] in force.
    pub frame: Group,
    params: Sent,
    substeps: Sent,
    /// What is sent of them, a slot each.
    slots: Vec<u8>,
    /// The same substeps without gaps, for who takes them all.
    pub all_substeps: Sent,
    pub pins: Sent,
    predict: Stage,
    bending: Option<Bending>,
    wind: Option<Stage>,
    springs: Option<Stage>,
}

#[derive(Debug)]
struct Bending {
    rows: wgpu::Buffer,
    /// The substep that `rows` are for.
    h: f32,
    moments: Stage,
    forces: Stage,
}

impl Forces {
    /// With `work` states beside the cloth's own.
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, work: usize) -> Result<Forces, String> {
        let size = size_of_val(cloth.rest.as_slice()) as u64;
        // Of the buffers that the cloth may come to need, the largest: bending's moments, its entries, springs, edges.
        let needed = (2 * size).max(24 * cloth.links.len() as u64).max(16 * cloth.triangles.len() as u64);
        let limits = gpu.device.limits();
        let largest = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if needed > largest {
            return Err(format!("the cloth needs buffers of {needed} bytes, the device binds {largest} at most"));
        }
        let u = gpu.buffer("u", size);
        let mut states = vec![State { x: gpu.vertex_buffer("x", size), p: gpu.buffer("p", size) }];
        states.extend((0..work).map(|_| State { x: gpu.buffer("x in work", size), p: gpu.buffer("p in work", size) }));
        let params = Sent::uniform(gpu, "params", size_of::<Params>());
        let substeps = Sent::uniform(gpu, "substeps", SLOT as usize);
        let all_substeps = Sent::storage(gpu, "all substeps", size_of::<Substep>());
        let frame = frame(gpu, &params, &substeps);
        let pins = Sent::storage(gpu, "pins", cloth.pinned.len().max(1) * size_of::<Pin>());
        let module = gpu.module("forces", shader!("predict", "forces"));
        let bound: Vec<Vec<_>> = states.iter().map(|state| predicted(state, &u, &pins)).collect();
        let predict = Stage::new(gpu, &frame, Entry::new(&module, "predict"), &bound);
        let (bending, wind, springs) = (None, None, None);
        Ok(Forces { states, u, frame, params, substeps, slots: Vec::new(), all_substeps, pins, predict, bending, wind, springs })
    }

    /// Uploads what this step has, and makes the kernels that it is the first to need. True if [`Forces::all_substeps`] is
    /// another buffer than before.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>, all: bool) -> bool {
        self.params.send(gpu, std::slice::from_ref(&plan.params));
        self.pins.send(gpu, plan.pins);
        if all {
            return self.all_substeps.send(gpu, plan.substeps);
        }
        self.slots.resize(plan.substeps.len() * SLOT as usize, 0);
        for (substep, slot) in plan.substeps.iter().zip(self.slots.chunks_mut(SLOT as usize)) {
            slot[..size_of::<Substep>()].copy_from_slice(bytemuck::bytes_of(substep));
        }
        if self.substeps.send(gpu, &self.slots) {
            self.frame = frame(gpu, &self.params, &self.substeps);
        }
        if plan.bending {
            let h = plan.coefficients.h;
            let Forces { states, u, frame, pins, bending, .. } = self;
            let bending = bending.get_or_insert_with(|| Bending::new(gpu, plan, states, u, frame, pins));
            if bending.h.to_bits() != h.to_bits() {
                gpu.write(&bending.rows, &plan.coefficients.bending);
                bending.h = h;
            }
        }
        if plan.wind && self.wind.is_none() {
            let panels = plan.cloth.panels();
            let buffers = (
                gpu.filled("panels", &panels.panels),
                gpu.filled("panel spans", &panels.around.spans),
                gpu.filled("panels around", &panels.around.items),
            );
            let bound = self.states.iter().map(|state| {
                vec![
                    (0, Bind::Read(&buffers.0)),
                    (1, Bind::Read(&buffers.1)),
                    (2, Bind::Read(&buffers.2)),
                    (3, Bind::Read(&state.x)),
                    (4, Bind::Read(&state.p)),
                    (5, Bind::Write(&self.u)),
                ]
            });
            let bound: Vec<Vec<_>> = bound.collect();
            let module = gpu.module("wind", shader!("wind"));
            self.wind = Some(Stage::new(gpu, &self.frame, Entry::new(&module, "wind"), &bound));
        }
        if plan.method == Method::Springs && self.springs.is_none() {
            let springs = plan.cloth.springs();
            let buffers = (gpu.filled("springs", &springs.items), gpu.filled("spring spans", &springs.spans));
            let bound = self.states.iter().map(|state| {
                vec![
                    (0, Bind::Read(&buffers.0)),
                    (1, Bind::Read(&buffers.1)),
                    (2, Bind::Read(&state.x)),
                    (3, Bind::Write(&self.u)),
                ]
            });
            let bound: Vec<Vec<_>> = bound.collect();
            let module = gpu.module("springs", shader!("springs"));
            self.springs = Some(Stage::new(gpu, &self.frame, Entry::new(&module, "springs"), &bound));
        }
        false
    }

    /// Binds the numbers of one substep for the stages encoded next.
    pub(crate) fn set_frame(&self, pass: &mut wgpu::ComputePass<'_>, substep: usize) {
        self.frame.set(pass, 0, &[(substep as u64 * SLOT) as u32]);
    }

    /// Dispatches of a substep.
    pub(crate) fn dispatches(plan: &Plan<'_>) -> usize {
        1 + usize::from(plan.bending) + usize::from(plan.wind) + usize::from(plan.method == Method::Springs)
    }

    /// Bytes that a substep's forces read and write, if what is gathered is read once.
    pub(crate) fn bytes(plan: &Plan<'_>) -> usize {
        let vertices = plan.cloth.rest.len();
        let bending =
            if plan.bending { 2 * size_of_val(plan.cloth.bending().entries.items.as_slice()) + 140 * vertices } else { 0 };
        let wind = if plan.wind { 28 * plan.cloth.triangles.len() + 72 * vertices } else { 0 };
        let springs = if plan.method == Method::Springs { 24 * plan.cloth.swept().len() + 48 * vertices } else { 0 };
        48 * vertices + bending + wind + springs
    }

    /// Encodes the stage for one substep that starts from state number `from`.
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, from: usize) {
        let vertices = plan.cloth.rest.len();
        let all = vertices + plan.pins.len();
        match self.bending.as_ref().filter(|_| plan.bending) {
            None => self.predict.encode(pass, from, &[], all),
            Some(bending) => {
                bending.moments.encode(pass, from, &[], all);
                bending.forces.encode(pass, from, &[], vertices);
            }
        }
        if let Some(wind) = self.wind.as_ref().filter(|_| plan.wind) {
            wind.encode(pass, from, &[], vertices);
        }
        if let Some(springs) = self.springs.as_ref().filter(|_| plan.method == Method::Springs) {
            springs.encode(pass, from, &[], vertices);
        }
    }
}

impl Bending {
    fn new(gpu: &Gpu, plan: &Plan<'_>, states: &[State], u: &wgpu::Buffer, frame: &Group, pins: &Sent) -> Bending {
        let entries = &plan.cloth.bending().entries;
        let rows = gpu.filled("bend rows", &plan.coefficients.bending);
        let spans = gpu.filled("bend spans", &entries.spans);
        let entries = gpu.filled("bend entries", &entries.items);
        let moments = gpu.buffer("moments", 2 * u.size());
        let module = gpu.module("bending", shader!("predict", "forces", "bending"));
        let table = [(4, Bind::Read(&rows)), (5, Bind::Read(&spans)), (6, Bind::Read(&entries)), (7, Bind::Write(&moments))];
        let gather: Vec<_> = states.iter().map(|state| [predicted(state, u, pins), table.to_vec()].concat()).collect();
        let spread: Vec<_> =
            states.iter().map(|state| [&[(0, Bind::Read(&state.x)), (2, Bind::Write(u))], &table[..]].concat()).collect();
        let moments = Stage::new(gpu, frame, Entry::new(&module, "bend_moments"), &gather);
        let forces = Stage::new(gpu, frame, Entry::new(&module, "bend_forces"), &spread);
        Bending { rows, h: plan.coefficients.h, moments, forces }
    }
}

/// What `forces.wgsl` binds.
fn predicted<'a>(state: &'a State, u: &'a wgpu::Buffer, pins: &'a Sent) -> Vec<(u32, Bind<'a>)> {
    vec![(0, Bind::Read(&state.x)), (1, Bind::Read(&state.p)), (2, Bind::Write(u)), (3, Bind::Read(&pins.buffer))]
}

fn frame(gpu: &Gpu, params: &Sent, substeps: &Sent) -> Group {
    let substep = Bind::Dynamic(&substeps.buffer, size_of::<Substep>() as u64);
    Group::new(gpu, &[(0, Bind::Uniform(&params.buffer)), (1, substep)])
}
