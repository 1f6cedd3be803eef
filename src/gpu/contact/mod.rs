//! Contact of the cloth with itself on the GPU: the algorithm of [`crate::contact`], in kernels of the same names.
//!
//! It follows the sweep, which here ignores colliders, and computes the final positions. The list of pairs has limited
//! room. If that does not suffice, the step stops, is rolled back and is repeated with more room, with the same result
//! bit for bit as if there had been enough. Therefore each step waits for the GPU once, and is committed after that.

mod course;
mod past;
mod stages;
pub(crate) mod status;

use glam::Vec4;

use crate::contact::Tally;
use crate::contact::device::{OnDevice, Table};
use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::gpu::forces::Forces;
use crate::gpu::stage::{Sent, WORKGROUP};
use crate::kernels::contact::Body;
use crate::model::cloth::Cloth;
use crate::options::{Contact, Crossing};
use crate::step::plan::Plan;

use course::Course;
use stages::Stages;
use status::{About, CROWDED, EARLY, Listed, NEAR, NO_ROOM, NODE, PART, SUMS, Status, TRACK, VERTEX};

/// Iterations of the response per substep.
const ITERATIONS: usize = crate::contact::ITERATIONS;
/// Limit on the dispatches of a substep.
pub(crate) const DISPATCHES: usize = 14 + 2 * ITERATIONS;
/// Initially, the list has room for one pair per this many vertices.
const FIRST_ROOM: usize = 2;
/// Least number of pairs for which dispatches over pairs are sized. With more pairs, each invocation handles several.
const LEAST_ITEMS: usize = 4096;

/// GPU buffers; `starts` and `pairs` have two halves, one of which contains the current lists.
#[derive(Debug)]
pub(super) struct Buffers {
    about: Sent,
    table: wgpu::Buffer,
    vertices: wgpu::Buffer,
    tracks: wgpu::Buffer,
    nodes: wgpu::Buffer,
    starts: wgpu::Buffer,
    pairs: wgpu::Buffer,
    near: wgpu::Buffer,
    sums: wgpu::Buffer,
    common: wgpu::Buffer,
    bodies: Sent,
    let_go: Sent,
}

/// The state to which a step is rolled back.
#[derive(Debug)]
struct Good {
    tracks: wgpu::Buffer,
    starts: wgpu::Buffer,
    pairs: wgpu::Buffer,
}

/// The state of contact of a cloth with itself, kept between steps.
#[derive(Debug)]
pub(crate) struct GpuContact {
    kept: OnDevice,
    options: Contact,
    table: Table,
    vertices: usize,
    /// Inverse of the mass of the whole cloth (1/kg), once it was computed.
    per_mass: Option<f32>,
    /// Number of pairs that the list has room for.
    room: usize,
    buffers: Buffers,
    good: Good,
    /// `None` if the kernels must be bound to new buffers.
    stages: Option<Stages>,
    staging: wgpu::Buffer,
    /// As of the end of the last good step.
    status: Status,
    course: Course,
}

impl GpuContact {
    /// Returns `None` if the cloth has no triangles.
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, options: Contact) -> Option<GpuContact> {
        let (kept, mut table) = OnDevice::new(cloth, options)?;
        let words = std::mem::take(&mut table.words);
        let (vertices, rows) = (cloth.rest.len(), table.rows as usize);
        let room = (vertices / FIRST_ROOM).max(LEAST_ITEMS);
        let (groups, halves) = (vertices.div_ceil(WORKGROUP), 2 * (rows + 1) + rows.div_ceil(WORKGROUP));
        let buffer = |label, bytes: usize| gpu.buffer(label, bytes as u64);
        let buffers = Buffers {
            about: Sent::uniform(gpu, "about contact", size_of::<About>()),
            table: gpu.filled("table of contact", &words),
            vertices: buffer("vertices in contact", VERTEX * vertices),
            tracks: buffer("paths in contact", TRACK * vertices),
            nodes: buffer("nodes of contact", NODE * (2 << table.depth)),
            starts: buffer("rows of pairs", 4 * halves),
            pairs: buffer("pairs", 2 * room * size_of::<Listed>()),
            near: buffer("near pairs", NEAR * room),
            sums: buffer("sums of contact", 4 * SUMS * vertices),
            common: buffer("status of contact", size_of::<Status>() + PART * groups),
            bodies: Sent::storage(gpu, "bodies in contact", size_of::<Body>()),
            let_go: Sent::storage(gpu, "pairs let go", size_of::<[u32; 2]>()),
        };
        let good = Good {
            tracks: buffer("paths before", TRACK * vertices),
            starts: buffer("rows before", 4 * (rows + 1)),
            pairs: buffer("pairs before", room * size_of::<Listed>()),
        };
        let staging = gpu.staging("status", size_of::<Status>() as u64);
        let status = Status::nothing();
        Some(GpuContact {
            kept,
            options,
            table,
            vertices,
            per_mass: None,
            room,
            buffers,
            good,
            stages: None,
            staging,
            status,
            course: Course::default(),
        })
    }

    /// Discards everything that depends on positions, because the state was replaced.
    pub(crate) fn forget(&mut self) {
        self.kept.forget();
        self.status = Status::nothing();
    }

    /// Must be called when the state's buffers or the masses were replaced: the next step then binds the new buffers.
    pub(crate) fn unbind(&mut self) {
        (self.stages, self.per_mass) = (None, None);
    }

    /// Whether the next step needs the positions on the CPU first, to search for intersections.
    pub(crate) fn must_look(&self, plan: &Plan<'_>) -> bool {
        self.kept.must_look(plan)
    }

    /// Searches for intersections at the positions `x` (m).
    pub(crate) fn look(&mut self, x: &[Vec4]) {
        let crossed = !self.kept.let_go().iter().all(Vec::is_empty);
        self.kept.look(x);
        if crossed || !self.kept.let_go().iter().all(Vec::is_empty) {
            // The ignored pairs may have changed, so the lists are rebuilt.
            self.status.since = status::NEVER;
        }
    }

    /// Intersections found by the last search.
    pub(crate) fn crossings(&self) -> impl Iterator<Item = Crossing> {
        self.kept.crossings()
    }

    /// Counts of the last step.
    pub(crate) fn tally(&self) -> Tally {
        let Status { pressing, detections, listed, near, acting, .. } = self.status;
        Tally { contacts: pressing, detections, listed, near: near + acting }
    }

    /// Uploads what the kernels need, to start from the end of the last good step.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>, forces: &Forces) {
        let GpuContact { kept, options, table, vertices, per_mass, room, buffers, stages, course, .. } = self;
        let [of_vertices, of_edges] = kept.let_go();
        let per_mass = *per_mass.get_or_insert_with(|| {
            let masses = plan.cloth.rest.iter().filter(|x| x.w > 0.0).map(|x| 1.0 / f64::from(x.w));
            (1.0 / masses.sum::<f64>().max(f64::MIN_POSITIVE)) as f32
        });
        let about = About {
            thickness: options.thickness,
            friction: options.friction,
            vertices: *vertices as u32,
            first_edge: table.first_edge,
            rows: table.rows,
            depth: table.depth,
            triangles: table.triangles,
            edges: table.edges,
            leaves: table.leaves,
            of_leaves: table.of_leaves,
            excess: table.excess,
            beside: table.beside,
            of_vertices: table.of_vertices,
            // Without the response, any pair must stop the step.
            room: if course.responds { *room as u32 } else { 0 },
            bodies: plan.bodies.len() as u32,
            pins: plan.cloth.pinned.len() as u32,
            let_go: of_vertices.len() as u32,
            let_go_of_edges: of_edges.len() as u32,
            groups: vertices.div_ceil(WORKGROUP) as u32,
            per_mass,
        };
        buffers.about.send(gpu, &[about]);
        let all: Vec<[u32; 2]> = of_vertices.iter().chain(of_edges).copied().collect();
        let moved = [buffers.bodies.send(gpu, plan.bodies), buffers.let_go.send(gpu, &all)];
        if moved.contains(&true) {
            *stages = None;
        }
        stages.get_or_insert_with(|| Stages::new(gpu, forces, buffers));
        if self.status.since < 0.0 && self.status.listed == 0 {
            // Clears the rows of a discarded state.
            gpu.write(&buffers.starts, 0, &vec![0_u32; table.rows as usize + 1]);
        }
        gpu.write(&buffers.common, 0, &[self.status.at_start()]);
    }

    /// Saves the state to which the step may have to be rolled back.
    fn keep(&self, gpu: &Gpu) {
        let GpuContact { buffers, good, status, room, .. } = self;
        let rows = 4 * (u64::from(self.table.rows) + 1);
        let pair = size_of::<Listed>() as u64;
        let (half, listed) = (u64::from(status.half), u64::from(status.listed));
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(&buffers.tracks, 0, &good.tracks, 0, good.tracks.size());
        encoder.copy_buffer_to_buffer(&buffers.starts, half * rows, &good.starts, 0, rows);
        if listed > 0 {
            encoder.copy_buffer_to_buffer(&buffers.pairs, half * *room as u64 * pair, &good.pairs, 0, listed * pair);
        }
        gpu.queue().submit([encoder.finish()]);
    }

    /// Rolls back to the saved state.
    fn go_back(&mut self, gpu: &Gpu) {
        let GpuContact { buffers, good, status, .. } = self;
        let rows = 4 * (u64::from(self.table.rows) + 1);
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(&good.tracks, 0, &buffers.tracks, 0, good.tracks.size());
        encoder.copy_buffer_to_buffer(&good.starts, 0, &buffers.starts, 0, rows);
        if status.listed > 0 {
            let bytes = u64::from(status.listed) * size_of::<Listed>() as u64;
            encoder.copy_buffer_to_buffer(&good.pairs, 0, &buffers.pairs, 0, bytes);
        }
        gpu.queue().submit([encoder.finish()]);
        status.half = 0;
    }

    /// Rolls back, and makes room for the needed pairs and a quarter more.
    fn grow(&mut self, gpu: &Gpu, needed: usize) {
        let room = (needed + needed / 4).next_multiple_of(WORKGROUP);
        let good = std::mem::replace(&mut self.good.pairs, gpu.buffer("pairs before", (room * size_of::<Listed>()) as u64));
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(&good, 0, &self.good.pairs, 0, good.size().min(self.good.pairs.size()));
        gpu.queue().submit([encoder.finish()]);
        self.make_room(gpu, room);
        self.go_back(gpu);
    }

    /// Replaces the lists by empty ones with room for this many pairs.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, room: usize) {
        self.buffers.pairs = gpu.buffer("pairs", (2 * room * size_of::<Listed>()) as u64);
        self.buffers.near = gpu.buffer("near pairs", (NEAR * room) as u64);
        (self.room, self.stages) = (room, None);
    }

    /// Starts a step: chooses the kernels of the first attempt and saves the state.
    pub(crate) fn begin(&mut self, gpu: &Gpu, substeps: usize) {
        self.course.begin(&self.status, substeps, self.vertices);
        self.keep(gpu);
    }

    /// Waits for the result of an attempt. Returns whether the step must be attempted again, from the state to which it
    /// was rolled back. An inner error is the number of pairs, if these were too many.
    pub(crate) fn judge(&mut self, gpu: &Gpu) -> Result<Result<bool, usize>, GpuFault> {
        let status: Status = gpu.mapped(&self.staging, bytemuck::pod_read_unaligned)?;
        let needed = status.needed as usize;
        let has = |reason| status.stopped & reason != 0;
        let most = gpu.most_table_bytes() / (3 * size_of::<Listed>());
        if has(CROWDED) || needed > most {
            self.go_back(gpu);
            self.forget();
            return Ok(Err(needed.max(status.listed as usize)));
        }
        if !has(NO_ROOM | EARLY) {
            self.status = status;
            return Ok(Ok(false));
        }
        self.course.change(has(NO_ROOM), has(EARLY));
        if needed > self.room {
            self.grow(gpu, needed);
        } else {
            self.go_back(gpu);
        }
        Ok(Ok(true))
    }

    /// Encodes a copy of the status after the step's commands.
    pub(crate) fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_buffer_to_buffer(&self.buffers.common, 0, &self.staging, 0, size_of::<Status>() as u64);
    }

    /// Encodes contact in substep number `index` after its sweep; `group` is an index of
    /// [`crate::gpu::state::PING_PONG`].
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, index: usize, group: usize) {
        let Some(stages) = &self.stages else { return };
        let looks = self.course.looks(index);
        stages.meet.dispatch(pass, group, &[], self.vertices);
        let decide = if looks { &stages.decide } else { &stages.decide_alone };
        decide.dispatch_workgroups(pass, group, &[], 1);
        if looks {
            self.encode_detection(stages, pass, group);
        }
        if self.course.responds {
            self.encode_response(stages, pass, plan, group);
        }
    }

    fn encode_detection(&self, stages: &Stages, pass: &mut wgpu::ComputePass<'_>, group: usize) {
        let rows = self.table.rows as usize;
        stages.begin_paths.dispatch(pass, group, &[], self.vertices);
        stages.bound.dispatch(pass, group, &[], 1 << self.table.depth);
        stages.refit.dispatch_workgroups(pass, group, &[], 1);
        stages.count.dispatch(pass, group, &[], rows);
        stages.scan.dispatch_workgroups(pass, group, &[], 1);
        if self.course.responds {
            stages.fill.dispatch(pass, group, &[], rows);
        }
    }

    fn encode_response(&self, stages: &Stages, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, group: usize) {
        let vertices = self.vertices;
        let items = |before: u32| (2 * before as usize).clamp(LEAST_ITEMS, self.room.max(LEAST_ITEMS));
        stages.find.dispatch(pass, group, &[], items(self.status.listed));
        let items = items(self.status.near + self.status.acting);
        stages.warm.dispatch(pass, group, &[], items);
        stages.take_first.dispatch(pass, group, &[], vertices);
        for iteration in 1..=ITERATIONS {
            stages.step.dispatch(pass, group, &[], items);
            let take = if iteration < ITERATIONS { &stages.take } else { &stages.take_last };
            take.dispatch(pass, group, &[], vertices);
        }
        stages.cut.dispatch(pass, group, &[], items);
        stages.finish.dispatch(pass, group, &[], vertices);
        if plan.cloth.pinned.is_empty() && plan.bodies.is_empty() {
            stages.give_back.dispatch(pass, group, &[], vertices);
        }
    }
}
