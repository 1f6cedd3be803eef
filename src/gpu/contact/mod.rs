//! Contact of the cloth with itself and with mesh colliders on the GPU: the algorithm of [`crate::contact`], in kernels of
//! the same names.
//!
//! It follows the sweep, which here ignores colliders, and computes the final positions. The list of pairs has limited
//! room. If that does not suffice, the step stops, is rolled back and is repeated with more room, with the same result
//! bit for bit as if there had been enough. Therefore each attempt at a step waits for the GPU, and is committed after that.

mod attempt;
pub(crate) mod encode;
mod kernel_choice;
mod past;
mod stages;
pub(crate) mod status;

use std::sync::Arc;

use glam::Vec4;

use crate::contact::Tally;
use crate::contact::device::HostContact;
use crate::contact::device::table::{ContactParams, Table};
use crate::device::Gpu;
use crate::gpu::forces::Forces;
use crate::gpu::stage::{Sent, WORKGROUP};
use crate::gpu::state::StateBuffers;
use crate::gpu::watch::Defects;
use crate::kernels::contact::Body;
use crate::model::cloth::Cloth;
use crate::model::mesh::Mesh;
use crate::options::Contact;
use crate::step::plan::Plan;

pub(crate) use attempt::Judgment;
use encode::MANY;
use kernel_choice::{KernelChoice, Response};
use stages::Stages;
use status::{BOX, Listed, NEAR, NODE, NORMALS, PART, SPACE, Status, StatusReadback, TRACK, VERTEX};

/// Initially, the list has room for so many pairs per vertex, because it takes milliseconds to make room for more; but for at
/// most so many, unless there are more vertices, and for at least so many.
const ROOM_OF_VERTEX: usize = 16;
const MAX_ROOM: usize = 1 << 18;
const MIN_ROOM: usize = 4096;

/// GPU buffers; `pairs` has two halves, one of which contains the current list. `near` is used by detection, too, which begins
/// before pairs are near.
pub(super) struct Buffers {
    contact_params: Sent,
    table: wgpu::Buffer,
    vertices: wgpu::Buffer,
    tracks: wgpu::Buffer,
    nodes: wgpu::Buffer,
    buckets: wgpu::Buffer,
    pairs: wgpu::Buffer,
    near: wgpu::Buffer,
    sums: wgpu::Buffer,
    contact_state: wgpu::Buffer,
    bodies: Sent,
    ignored: Sent,
    boxes: wgpu::Buffer,
    normals: wgpu::Buffer,
}

/// The state to which a step is rolled back.
struct Checkpoint {
    tracks: wgpu::Buffer,
    pairs: wgpu::Buffer,
    /// Number of pairs that there is room for.
    room: usize,
    /// The cloth's own state, and what the stability check found. Attempts do not change them, but a step that is undone has.
    cloth: StateBuffers,
    found: wgpu::Buffer,
}

impl Checkpoint {
    fn new(gpu: &Gpu, vertices: usize, all_vertices: usize, room: usize) -> Checkpoint {
        let buffer = |label, bytes: usize| gpu.buffer(label, bytes as u64);
        let [x, p] = ["x before", "p before"].map(|label| buffer(label, vertices * size_of::<Vec4>()));
        Checkpoint {
            tracks: buffer("paths before", TRACK * all_vertices),
            pairs: Checkpoint::pairs(gpu, room),
            room,
            cloth: StateBuffers { x, p },
            found: buffer("found before", size_of::<Defects>()),
        }
    }

    fn pairs(gpu: &Gpu, room: usize) -> wgpu::Buffer {
        gpu.buffer("pairs before", (room * size_of::<Listed>()) as u64)
    }
}

/// The state of contact of a cloth with itself, kept between steps.
pub(crate) struct GpuContact {
    /// What is done on the CPU: the search for intersections, and what mesh colliders do.
    pub(crate) on_cpu: HostContact,
    /// What is the same in every step.
    params: ContactParams,
    /// Inverse of the mass of the whole cloth (1/kg), once it was computed.
    per_mass: Option<f32>,
    /// Number of pairs that the list has room for, and the space for what detection compares.
    pub(crate) room: usize,
    space: usize,
    buffers: Buffers,
    checkpoint: Checkpoint,
    /// Whether `checkpoint` is the state at the start of this step.
    is_saved: bool,
    /// `None` if the kernels must be bound to new buffers.
    stages: Option<Stages>,
    staging: wgpu::Buffer,
    /// As of the end of the last good step.
    status: Status,
    /// The same at the start of the last step, to which one that fails or is undone goes back.
    before: Status,
    choice: KernelChoice,
    /// How far (m) vertices may be carried in this step, besides the common motion.
    max_carry: f32,
    /// Whether this attempt lists all pairs that may meet wherever on their ways contact stops vertices.
    covers_stops: bool,
    /// Whether an attempt may still do that: once.
    may_cover_stops: bool,
    /// Number of substeps of the current step.
    substeps: usize,
    /// Number of pairs that act from which workgroups collect their sums.
    pub(crate) many: u32,
}

impl GpuContact {
    /// Returns `None` if the cloth has no triangles with an area. Without `contact`, the cloth meets the mesh colliders only.
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, contact: Option<Contact>, meshes: Vec<Arc<Mesh>>) -> Option<GpuContact> {
        let (on_cpu, params, Table(table)) = HostContact::new(cloth, contact, meshes)?;
        let (vertices, all) = (cloth.rest.len(), params.all_vertices as usize);
        let room = (ROOM_OF_VERTEX * vertices).min(MAX_ROOM).max(vertices).max(MIN_ROOM);
        let [groups, mesh_groups] = [vertices, params.mesh_vertices()].map(|vertices| vertices.div_ceil(WORKGROUP) as u32);
        let Contact { thickness, friction } = contact.unwrap_or_default();
        let has_self_contact = on_cpu.surface.has_self_contact.into();
        let vertices = vertices as u32;
        let params = ContactParams { thickness, friction, vertices, has_self_contact, groups, mesh_groups, ..params };
        let buffer = |label, bytes: usize| gpu.buffer(label, bytes as u64);
        let buffers = Buffers {
            contact_params: Sent::uniform(gpu, "parameters of contact", size_of::<ContactParams>()),
            table: gpu.filled("table of contact", &table),
            vertices: buffer("vertices in contact", VERTEX * all),
            tracks: buffer("paths in contact", TRACK * (all + params.mesh_vertices())),
            nodes: buffer("nodes of contact", NODE * params.nodes()),
            buckets: buffer("buckets of pairs", 4 * (params.rows as usize).next_power_of_two()),
            pairs: buffer("pairs", 2 * room * size_of::<Listed>()),
            near: buffer("near pairs", NEAR.max(SPACE) * room),
            sums: gpu.filled("sums of contact", &status::NO_SUMS.repeat(cloth.rest.len())),
            contact_state: buffer("state of contact", size_of::<StatusReadback>() + PART * (groups + mesh_groups) as usize),
            bodies: Sent::storage(gpu, "bodies in contact", size_of::<Body>()),
            ignored: Sent::storage(gpu, "ignored pairs", size_of::<[u32; 2]>()),
            boxes: buffer("boxes of contact", BOX * params.boxes()),
            normals: buffer("normals in contact", NORMALS * on_cpu.surface.cloth_triangles()),
        };
        let checkpoint = Checkpoint::new(gpu, cloth.rest.len(), all, room);
        let staging = gpu.staging("status", size_of::<StatusReadback>() as u64);
        let status = Status::nothing();
        Some(GpuContact {
            on_cpu,
            params,
            per_mass: None,
            room,
            space: room,
            buffers,
            checkpoint,
            is_saved: false,
            stages: None,
            staging,
            status,
            before: status,
            choice: KernelChoice::default(),
            max_carry: 0.0,
            covers_stops: false,
            may_cover_stops: false,
            substeps: 0,
            many: MANY,
        })
    }

    /// Discards everything that depends on positions, because the state was replaced.
    pub(crate) fn forget(&mut self) {
        self.on_cpu.forget();
        (self.status, self.choice) = (Status::nothing(), KernelChoice::default());
    }

    /// Must be called when the state's buffers or the masses were replaced: the next step then binds the new buffers.
    pub(crate) fn unbind(&mut self) {
        (self.stages, self.per_mass) = (None, None);
    }

    /// Searches for intersections at the start of a step, with the cloth at the positions `x` (m). Returns positions
    /// from which to start instead, if anything touched exactly.
    pub(crate) fn find_crossings(&mut self, plan: &Plan<'_>, x: Vec<Vec4>) -> Option<Vec<Vec4>> {
        let crossed = !self.on_cpu.crossings.ignored.iter().all(Vec::is_empty);
        let moved = self.on_cpu.find_crossings(plan, x, self.status.since == status::NEVER);
        if crossed || !self.on_cpu.crossings.ignored.iter().all(Vec::is_empty) {
            // The ignored pairs may have changed, so the lists are rebuilt.
            self.status.since = status::NEVER;
        }
        moved
    }

    /// Ignores the pairs of what crosses at the end of a step because it is pinched, with the cloth at the positions `x` (m).
    pub(crate) fn ignore_pinched(&mut self, plan: &Plan<'_>, x: Vec<Vec4>) {
        if self.on_cpu.ignore_pinched(plan, x) {
            self.status.since = status::NEVER;
        }
    }

    /// Counts of the last step.
    pub(crate) fn tally(&self) -> Tally {
        let Status { pressing, detections, listed, near, acting, squeezed, .. } = self.status;
        Tally { contacts: pressing, detections, listed, near: near + acting, squeezed }
    }

    /// Uploads what the kernels need, to start from the end of the last good step.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>, forces: &Forces) {
        let GpuContact { on_cpu, params, per_mass, room, buffers, stages, choice, max_carry, covers_stops, .. } = self;
        let [of_vertices, of_edges] = &on_cpu.crossings.ignored;
        let per_mass = *per_mass.get_or_insert_with(|| {
            let masses = plan.cloth.rest.iter().filter(|x| x.w > 0.0).map(|x| 1.0 / f64::from(x.w));
            (1.0 / masses.sum::<f64>().max(f64::MIN_POSITIVE)) as f32
        });
        let [turn_x, turn_y, turn_z, center, travel] = on_cpu.turn(plan);
        let params = ContactParams {
            // Without a response, any pair must stop the step.
            room: if choice.response == Response::None { 0 } else { *room as u32 },
            bodies: plan.bodies.len() as u32,
            has_kinematic: on_cpu.kinematic(plan),
            meshes_rest: on_cpu.bodies.are_still.into(),
            ignored: of_vertices.len() as u32,
            ignored_edges: of_edges.len() as u32,
            per_mass,
            spacing: choice.spacing,
            max_carry: *max_carry,
            covers_stops: (*covers_stops).into(),
            entangled: on_cpu.crossings.entangled.len() as u32,
            turn_x,
            turn_y,
            turn_z,
            center,
            travel,
            ..*params
        };
        buffers.contact_params.send(gpu, &[params]);
        let entangled = on_cpu.crossings.entangled.iter().map(|&vertex| [vertex, 0]);
        let all: Vec<[u32; 2]> = of_vertices.iter().chain(of_edges).copied().chain(entangled).collect();
        let moved = [buffers.bodies.send(gpu, plan.bodies), buffers.ignored.send(gpu, &all)];
        if moved.contains(&true) {
            *stages = None;
        }
        stages.get_or_insert_with(|| Stages::new(gpu, forces, buffers, params.mesh_vertices() > 0));
        gpu.write(&buffers.contact_state, 0, &[self.status.at_start()]);
    }
}
