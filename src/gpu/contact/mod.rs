//! Contact of the cloth with itself on the device: what [`crate::contact`] does, in kernels of the same names.
//!
//! It comes behind the sweep, which moves vertices without colliders, and puts them where they are to go. A list of pairs has room for so many:
//! where it has too little, the step stops, is taken back to its start, and is taken once more with more room, to the same bits as if there
//! had been enough. So a step waits for the device once, and is committed after that.

mod course;
mod past;
mod stages;
pub(crate) mod status;

use glam::Vec4;

use crate::contact::Tally;
use crate::contact::device::{OnDevice, Table};
use crate::device::Gpu;
use crate::gpu::forces::Forces;
use crate::gpu::stage::{Sent, WORKGROUP};
use crate::gpu_fault::GpuFault;
use crate::kernels::contact::Body;
use crate::model::cloth::Cloth;
use crate::options::{Contact, Crossing};
use crate::step::plan::Plan;

use course::Course;
use stages::Stages;
use status::{About, CROWDED, EARLY, Listed, NEAR, NO_ROOM, NODE, PART, SUMS, Status, TRACK, VERTEX};

/// Steps of the multipliers in a substep.
const ITERATIONS: usize = crate::contact::ITERATIONS;
/// Dispatches of a substep, at most.
pub(crate) const DISPATCHES: usize = 14 + 2 * ITERATIONS;
/// Vertices for each of which a list has room for a pair at first.
const FIRST_ROOM: usize = 2;
/// Pairs that dispatches over pairs are made for, at least: where there are more, each invocation has several.
const LEAST_ITEMS: usize = 4096;

/// Buffers; `starts` and `pairs` have two halves, one of which is in force.
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

/// Where a step goes back to.
#[derive(Debug)]
struct Good {
    tracks: wgpu::Buffer,
    starts: wgpu::Buffer,
    pairs: wgpu::Buffer,
}

/// Contact of a cloth with itself, from step to step.
#[derive(Debug)]
pub(crate) struct GpuContact {
    kept: OnDevice,
    options: Contact,
    table: Table,
    vertices: usize,
    /// One over the cloth's mass (1/kg), once it is known.
    per_mass: Option<f32>,
    /// Pairs that a list has room for.
    room: usize,
    buffers: Buffers,
    good: Good,
    /// None where buffers are others than before.
    stages: Option<Stages>,
    staging: wgpu::Buffer,
    /// At the end of the last good step.
    status: Status,
    course: Course,
}

impl GpuContact {
    /// None if the cloth has no triangles.
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

    /// Forgets what it knows of the state, which was put elsewhere.
    pub(crate) fn forget(&mut self) {
        self.kept.forget();
        self.status = Status::nothing();
    }

    /// Binds other buffers of the state from the next step on, of a cloth whose masses may be others.
    pub(crate) fn unbind(&mut self) {
        (self.stages, self.per_mass) = (None, None);
    }

    /// Whether a step must know where the cloth is before it begins.
    pub(crate) fn must_look(&self, plan: &Plan<'_>) -> bool {
        self.kept.must_look(plan)
    }

    /// Looks what crosses where the vertices are.
    pub(crate) fn look(&mut self, x: &[Vec4]) {
        let crossed = !self.kept.let_go().iter().all(Vec::is_empty);
        self.kept.look(x);
        if crossed || !self.kept.let_go().iter().all(Vec::is_empty) {
            // Other pairs are let go.
            self.status.since = status::NEVER;
        }
    }

    /// What crossed where it looked last.
    pub(crate) fn crossings(&self) -> impl Iterator<Item = Crossing> {
        self.kept.crossings()
    }

    /// What the last step came to.
    pub(crate) fn tally(&self) -> Tally {
        let Status { pressing, detections, listed, near, acting, .. } = self.status;
        Tally { contacts: pressing, detections, listed, near: near + acting }
    }

    /// Makes ready for a step of these numbers, from where the last one ended.
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
            // What is not responded to has no room.
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
            // Rows of a state that was left.
            gpu.write(&buffers.starts, 0, &vec![0_u32; table.rows as usize + 1]);
        }
        gpu.write(&buffers.common, 0, &[self.status.at_start()]);
    }

    /// Copies what a step goes back to.
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

    /// Goes back to what was kept.
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

    /// Goes back and makes room for so many pairs, and some more.
    fn grow(&mut self, gpu: &Gpu, needed: usize) {
        let room = (needed + needed / 4).next_multiple_of(WORKGROUP);
        let good = std::mem::replace(&mut self.good.pairs, gpu.buffer("pairs before", (room * size_of::<Listed>()) as u64));
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(&good, 0, &self.good.pairs, 0, good.size().min(self.good.pairs.size()));
        gpu.queue().submit([encoder.finish()]);
        self.make_room(gpu, room);
        self.go_back(gpu);
    }

    /// Makes lists that have room for so many pairs, without any.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, room: usize) {
        self.buffers.pairs = gpu.buffer("pairs", (2 * room * size_of::<Listed>()) as u64);
        self.buffers.near = gpu.buffer("near pairs", (NEAR * room) as u64);
        (self.room, self.stages) = (room, None);
    }

    /// Begins a step of so many substeps: how it is tried first.
    pub(crate) fn begin(&mut self, gpu: &Gpu, substeps: usize) {
        self.course.begin(&self.status, substeps, self.vertices);
        self.keep(gpu);
    }

    /// Waits for what a step came to, and goes on from it, or goes back; then says whether it is to be tried once more. A step that
    /// cannot be taken fails with the pairs that were too many.
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

    /// Copies the status behind what is encoded.
    pub(crate) fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_buffer_to_buffer(&self.buffers.common, 0, &self.staging, 0, size_of::<Status>() as u64);
    }

    /// Encodes contact in substep number `index`, number `group` of [`crate::gpu::state::PING_PONG`], behind its sweep.
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
