//! Stage 1 on the GPU: the state, and the forces that the scene has. A term that is absent has no kernel and no buffer.

use crate::cloth::Cloth;
use crate::kernels::{Params, Pin, Substep};
use crate::options::Method;
use crate::plan::Plan;

use super::SLOT;
use super::device::{Bind, Gpu, Group, Stage, shader};

/// The state's buffers and the force kernels.
#[derive(Debug)]
pub(crate) struct Forces {
    /// Positions and inverse masses, last displacements, displacements in the making.
    pub x: wgpu::Buffer,
    pub p: wgpu::Buffer,
    pub u: wgpu::Buffer,
    /// [`Params`] and the [`Substep`] in force.
    pub frame: Group,
    params: wgpu::Buffer,
    substeps: wgpu::Buffer,
    pins: wgpu::Buffer,
    predict: Stage,
    move_pins: Stage,
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
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth) -> Result<Forces, String> {
        let size = size_of_val(cloth.rest.as_slice()) as u64;
        // Of the buffers that the cloth may come to need, the largest: bending's moments, its entries, springs, edges.
        let needed = (2 * size).max(24 * cloth.links.len() as u64).max(16 * cloth.triangles.len() as u64);
        let limits = gpu.device.limits();
        let largest = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if needed > largest {
            return Err(format!("the cloth needs buffers of {needed} bytes, the device binds {largest} at most"));
        }
        let [p, u] = ["p", "u"].map(|name| gpu.buffer(name, size));
        let x = gpu.vertex_buffer("x", size);
        let params = gpu.uniform("params", &[0; size_of::<Params>()]);
        let substeps = gpu.uniform("substeps", &[0; SLOT as usize]);
        let frame = frame(gpu, &params, &substeps);
        let pins = gpu.buffer("pins", (cloth.pinned.len().max(1) * size_of::<Pin>()) as u64);
        let module = gpu.module("forces", shader!("forces"));
        let predict =
            Stage::new(gpu, &frame, &module, "predict", &[(0, Bind::Read(&x)), (1, Bind::Read(&p)), (2, Bind::Write(&u))]);
        let bound = [(0, Bind::Read(&x)), (2, Bind::Write(&u)), (3, Bind::Read(&pins))];
        let move_pins = Stage::new(gpu, &frame, &module, "move_pins", &bound);
        let (bending, wind, springs) = (None, None, None);
        Ok(Forces { x, p, u, frame, params, substeps, pins, predict, move_pins, bending, wind, springs })
    }

    /// Uploads what this step has, and makes the kernels that it is the first to need.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        let count = plan.substeps.len();
        if self.substeps.size() < count as u64 * SLOT {
            self.substeps = gpu.uniform("substeps", &vec![0; count.next_power_of_two() * SLOT as usize]);
            self.frame = frame(gpu, &self.params, &self.substeps);
        }
        gpu.write(&self.params, std::slice::from_ref(&plan.params));
        let mut slots = vec![0_u8; count * SLOT as usize];
        for (substep, slot) in plan.substeps.iter().zip(slots.chunks_mut(SLOT as usize)) {
            slot[..size_of::<Substep>()].copy_from_slice(bytemuck::bytes_of(substep));
        }
        gpu.write(&self.substeps, &slots);
        if !plan.pins.is_empty() {
            gpu.write(&self.pins, plan.pins);
        }
        if plan.bending {
            let h = plan.coefficients.h;
            let bending = self.bending.get_or_insert_with(|| Bending::new(gpu, &self.frame, plan, [&self.x, &self.p, &self.u]));
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
            let bound = [
                (0, Bind::Read(&buffers.0)),
                (1, Bind::Read(&buffers.1)),
                (2, Bind::Read(&buffers.2)),
                (3, Bind::Read(&self.x)),
                (4, Bind::Read(&self.p)),
                (5, Bind::Write(&self.u)),
            ];
            self.wind = Some(Stage::new(gpu, &self.frame, &gpu.module("wind", shader!("wind")), "wind", &bound));
        }
        if plan.method == Method::Springs && self.springs.is_none() {
            let springs = plan.cloth.springs();
            let buffers = (gpu.filled("springs", &springs.items), gpu.filled("spring spans", &springs.spans));
            let bound =
                [(0, Bind::Read(&buffers.0)), (1, Bind::Read(&buffers.1)), (2, Bind::Read(&self.x)), (3, Bind::Write(&self.u))];
            self.springs = Some(Stage::new(gpu, &self.frame, &gpu.module("springs", shader!("springs")), "springs", &bound));
        }
    }

    /// Encodes the stage for one substep; leaves the frame's group bound to it.
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, substep: usize) {
        let vertices = plan.cloth.rest.len();
        self.frame.set(pass, 0, &[(substep as u64 * SLOT) as u32]);
        self.predict.encode(pass, &[], vertices);
        if let Some(bending) = self.bending.as_ref().filter(|_| plan.bending) {
            bending.moments.encode(pass, &[], vertices);
            bending.forces.encode(pass, &[], vertices);
        }
        if let Some(wind) = self.wind.as_ref().filter(|_| plan.wind) {
            wind.encode(pass, &[], vertices);
        }
        if let Some(springs) = self.springs.as_ref().filter(|_| plan.method == Method::Springs) {
            springs.encode(pass, &[], vertices);
        }
        if !plan.pins.is_empty() {
            self.move_pins.encode(pass, &[], plan.pins.len());
        }
    }
}

impl Bending {
    fn new(gpu: &Gpu, frame: &Group, plan: &Plan<'_>, [x, p, u]: [&wgpu::Buffer; 3]) -> Bending {
        let entries = &plan.cloth.bending().entries;
        let rows = gpu.filled("bend rows", &plan.coefficients.bending);
        let spans = gpu.filled("bend spans", &entries.spans);
        let entries = gpu.filled("bend entries", &entries.items);
        let moments = gpu.buffer("moments", 2 * x.size());
        let module = gpu.module("bending", shader!("bending"));
        let table = [(0, Bind::Read(&rows)), (1, Bind::Read(&spans)), (2, Bind::Read(&entries)), (3, Bind::Read(x))];
        let gather = [&table[..], &[(4, Bind::Read(p)), (5, Bind::Write(&moments))]].concat();
        let spread = [&table[..], &[(6, Bind::Read(&moments)), (7, Bind::Write(u))]].concat();
        let moments = Stage::new(gpu, frame, &module, "bend_moments", &gather);
        let forces = Stage::new(gpu, frame, &module, "bend_forces", &spread);
        Bending { rows, h: plan.coefficients.h, moments, forces }
    }
}

fn frame(gpu: &Gpu, params: &wgpu::Buffer, substeps: &wgpu::Buffer) -> Group {
    Group::new(gpu, &[(0, Bind::Uniform(params)), (1, Bind::Dynamic(substeps, size_of::<Substep>() as u64))])
}
