//! The kernels run by wgpu: all substeps of a step in one encoder and one submit, nothing read back until asked for.
//!
//! A [`Gpu`] lives as long as the program, [`GpuEngine`] and its buffers as long as the cloth, [`Plan`] for one step.

mod device;
mod forces;
mod normals;

use glam::Vec4;

use crate::cloth::Cloth;
use crate::engine::Failure;
use crate::kernels::{Body, Edge};
use crate::options::Method;
use crate::plan::Plan;
pub use device::Gpu;
#[cfg(test)]
pub(crate) use device::WORKGROUP;
pub(crate) use device::shader;
use device::{Bind, Stage};
pub(crate) use forces::Forces;
use normals::Normals;
pub use normals::Surface;

/// From this many vertices on a GPU beats the CPU: in `benches/results/table_h200.md` its 0.52 ms a frame are passed at
/// about 1240, and a part of the frame is spent elsewhere.
pub(crate) const WORTHWHILE: usize = 1536;

/// Rounded up so that a uniform of any size may start there.
const SLOT: u64 = 256;
/// Dispatches in one submit, about: a driver takes the device away from work that holds it for seconds.
const LONGEST_SUBMIT: usize = 16_384;
/// What `commit.wgsl` calls none.
const NONE: u32 = u32::MAX;

/// The edges of one colour: `project.wgsl`'s `Batch`.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Batch {
    pub first: u32,
    pub count: u32,
}

/// A cloth on the GPU.
#[derive(Debug)]
pub(crate) struct GpuEngine {
    gpu: Gpu,
    forces: Forces,
    batches: Vec<Batch>,
    edges: wgpu::Buffer,
    /// The substep that `edges` are for.
    edges_h: Option<f32>,
    /// The method's edge kernel.
    sweep: Stage,
    advance: Stage,
    contact: Option<Contact>,
    check: Stage,
    commit: Stage,
    x_good: wgpu::Buffer,
    p_good: wgpu::Buffer,
    first_bad: wgpu::Buffer,
    staging: wgpu::Buffer,
    /// Made when the cloth is first drawn.
    normals: Option<Normals>,
}

/// The stage that knows colliders, made when there are some, and made again when there are more.
#[derive(Debug)]
struct Contact {
    stage: Stage,
    bodies: wgpu::Buffer,
    capacity: usize,
}

impl GpuEngine {
    pub(crate) fn new(gpu: Gpu, cloth: &Cloth, method: Method) -> Result<GpuEngine, String> {
        let batches: Vec<Batch> =
            cloth.colors.iter().map(|range| Batch { first: range.start as u32, count: range.len() as u32 }).collect();
        gpu.clone().checked(|| {
            let size = size_of_val(cloth.rest.as_slice()) as u64;
            let forces = Forces::new(&gpu, cloth)?;
            let edges = gpu.buffer("edges", (cloth.swept().len().max(1) * size_of::<Edge>()) as u64);
            let mut slots = vec![0_u8; SLOT as usize * batches.len().max(1)];
            for (batch, slot) in batches.iter().zip(slots.chunks_mut(SLOT as usize)) {
                slot[..size_of::<Batch>()].copy_from_slice(bytemuck::bytes_of(batch));
            }
            let slots = gpu.uniform("batches", &slots);
            let [x_good, p_good] = ["x_good", "p_good"].map(|name| gpu.buffer(name, size));
            let first_bad = gpu.buffer("first_bad", 4);
            let staging = gpu.staging("state", 2 * size + 4);

            let edge_kernels = gpu.module("project", shader!("project"));
            let moves = gpu.module("contact", shader!("contact"));
            let keeps = gpu.module("commit", shader!("commit"));
            let (x, p, u) = (&forces.x, &forces.p, &forces.u);
            let swept = [
                (0, Bind::Dynamic(&slots, size_of::<Batch>() as u64)),
                (1, Bind::Read(&edges)),
                (2, Bind::Read(x)),
                (3, Bind::Write(u)),
            ];
            let checked = [(0, Bind::Write(x)), (1, Bind::Write(p)), (4, Bind::Write(&first_bad))];
            let kept = [(2, Bind::Write(&x_good)), (3, Bind::Write(&p_good))];
            let frame = &forces.frame;
            let entry = if matches!(method, Method::Relaxation { .. }) { "relax" } else { "project" };
            let sweep = Stage::new(&gpu, frame, &edge_kernels, entry, &swept);
            let advance =
                Stage::new(&gpu, frame, &moves, "advance", &[(0, Bind::Write(x)), (1, Bind::Write(p)), (2, Bind::Read(u))]);
            let check = Stage::new(&gpu, frame, &keeps, "check", &checked);
            let commit = Stage::new(&gpu, frame, &keeps, "commit", &[&checked[..], &kept[..]].concat());
            let contact = None;
            let edges_h = None;
            let mut engine = GpuEngine {
                gpu,
                forces,
                batches,
                edges,
                edges_h,
                sweep,
                advance,
                contact,
                check,
                commit,
                x_good,
                p_good,
                first_bad,
                staging,
                normals: None,
            };
            engine.set(&cloth.rest, &vec![Vec4::ZERO; cloth.rest.len()]);
            Ok(engine)
        })
    }

    pub(crate) fn adapter(&self) -> &str {
        &self.gpu.name
    }

    pub(crate) fn position_buffer(&self) -> &wgpu::Buffer {
        &self.forces.x
    }

    /// Submits one step; returns before it is done.
    pub(crate) fn step(&mut self, plan: &Plan<'_>) -> Result<(), Failure> {
        let gpu = self.gpu.clone();
        gpu.checked(|| {
            self.submit(plan);
            Ok(())
        })
        .map_err(Failure::Gpu)
    }

    fn submit(&mut self, plan: &Plan<'_>) {
        self.forces.prepare(&self.gpu, plan);
        if self.edges_h != Some(plan.coefficients.h) && plan.sweeps > 0 {
            self.gpu.write(&self.edges, &plan.coefficients.edges);
            self.edges_h = Some(plan.coefficients.h);
        }
        if !plan.bodies.is_empty() {
            self.prepare_contact(plan.bodies);
        }
        let vertices = plan.cloth.rest.len();
        let advance = match &self.contact {
            Some(contact) if !plan.bodies.is_empty() => &contact.stage,
            _ => &self.advance,
        };
        let dispatches = 8 + plan.sweeps as usize * self.batches.len();
        let substeps: Vec<usize> = (0..plan.substeps.len()).collect();
        for some in substeps.chunks((LONGEST_SUBMIT / dispatches).max(1)) {
            let mut encoder = self.gpu.encoder();
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                for &substep in some {
                    self.forces.encode(&mut pass, plan, substep);
                    for _ in 0..plan.sweeps {
                        for (color, batch) in self.batches.iter().enumerate() {
                            self.sweep.encode(&mut pass, &[(color as u64 * SLOT) as u32], batch.count as usize);
                        }
                    }
                    advance.encode(&mut pass, &[], vertices);
                }
                if some.last() == substeps.last() {
                    self.check.encode(&mut pass, &[], vertices);
                    self.commit.encode(&mut pass, &[], vertices);
                }
            }
            self.gpu.queue.submit([encoder.finish()]);
        }
    }

    fn prepare_contact(&mut self, bodies: &[Body]) {
        let contact = match &mut self.contact {
            Some(contact) if contact.capacity >= bodies.len() => contact,
            small => {
                let capacity = bodies.len().next_power_of_two();
                let buffer = self.gpu.buffer("bodies", (capacity * size_of::<Body>()) as u64);
                let Forces { x, p, u, frame, .. } = &self.forces;
                let bound = [(0, Bind::Write(x)), (1, Bind::Write(p)), (2, Bind::Read(u)), (3, Bind::Read(&buffer))];
                let module = self.gpu.module("contact", shader!("contact"));
                let stage = Stage::new(&self.gpu, frame, &module, "contact", &bound);
                small.insert(Contact { stage, bodies: buffer, capacity })
            }
        };
        self.gpu.write(&contact.bodies, bodies);
    }

    /// Puts the state somewhere else.
    pub(crate) fn set(&mut self, x: &[Vec4], p: &[Vec4]) {
        for (buffer, values) in [(&self.forces.x, x), (&self.forces.p, p), (&self.x_good, x), (&self.p_good, p)] {
            self.gpu.write(buffer, values);
        }
        self.gpu.write(&self.first_bad, &[NONE]);
    }

    /// Waits for what was submitted.
    pub(crate) fn wait(&self) -> Result<(), Failure> {
        self.gpu.wait().map_err(Failure::Gpu)
    }

    /// Waits for the GPU and shows its state to `look`; then fails if it had to go back to that of an earlier step.
    pub(crate) fn read(&mut self, look: impl FnOnce(&[Vec4], &[Vec4])) -> Result<(), Failure> {
        let size = self.forces.x.size();
        let parts = [(&self.forces.x, 0), (&self.forces.p, size), (&self.first_bad, 2 * size)];
        let seen = self.gpu.read(&self.staging, &parts, self.gpu.encoder(), |bytes| {
            let (state, first_bad) = bytes.split_at(2 * size as usize);
            let first_bad: u32 = bytemuck::pod_read_unaligned(first_bad);
            let state: &[Vec4] = bytemuck::cast_slice(state);
            let (x, p) = state.split_at(state.len() / 2);
            look(x, p);
            first_bad
        });
        match seen.map_err(Failure::Gpu)? {
            NONE => Ok(()),
            vertex => {
                self.gpu.write(&self.first_bad, &[NONE]);
                Err(Failure::Unstable(vertex as usize))
            }
        }
    }
}
