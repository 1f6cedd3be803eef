//! The attempts of a step: saves the state before them, judges each, and rolls back if another is necessary.

use std::ops::Range;

use glam::Vec4;

use super::status::{CLOSE, CROWDED, EARLY, Listed, NEAR, NEVER, NO_ROOM, RUN_OVER, SPACE, Status, StatusReadback, TRACK, noted};
use super::{Checkpoint, GpuContact};
use crate::contact::max_listed;
use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::gpu::stage::WORKGROUP;
use crate::gpu::state::StateBuffers;
use crate::step::plan::Plan;

/// What becomes of an attempt. The state was rolled back unless it is good.
pub(crate) enum Judgment {
    Good,
    /// The step must be attempted again.
    Again,
    /// It must be attempted again after a search for intersections.
    Search,
    /// There are too many pairs: this many are listed, or are candidates, or this many pairs of leaves meet.
    Crowded(usize),
}

impl GpuContact {
    /// The places of the listed pairs in half 0 of a list with room for this many, in bytes: those of a vertex and a
    /// triangle at its start, those of two edges at its end.
    pub(super) fn places(&self, room: usize) -> [Range<u64>; 2] {
        let pair = size_of::<Listed>() as u64;
        let Status { with_vertices, with_edges, .. } = self.status;
        [0..u64::from(with_vertices) * pair, (room as u64 - u64::from(with_edges)) * pair..room as u64 * pair]
    }

    /// Copies the listed pairs from a half of a list to another one. Each is given by its buffer, by where the half begins there, in
    /// bytes, and by how many pairs that has room for.
    pub(super) fn copy_pairs(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (from, from_first, from_room): (&wgpu::Buffer, u64, usize),
        (to, to_first, to_room): (&wgpu::Buffer, u64, usize),
    ) {
        for (from_place, to_place) in self.places(from_room).into_iter().zip(self.places(to_room)) {
            if !from_place.is_empty() {
                let bytes = from_place.end - from_place.start;
                encoder.copy_buffer_to_buffer(from, from_first + from_place.start, to, to_first + to_place.start, bytes);
            }
        }
    }

    /// The current half of the list, for [`GpuContact::copy_pairs`].
    pub(super) fn current(&self) -> (&wgpu::Buffer, u64, usize) {
        (&self.buffers.pairs, u64::from(self.status.half) * (self.room * size_of::<Listed>()) as u64, self.room)
    }

    /// Encodes a copy of the state to which the step may have to be rolled back, unless that was done: that of contact, and the
    /// cloth's with what its stability check `found`.
    pub(crate) fn save(&mut self, encoder: &mut wgpu::CommandEncoder, cloth: &StateBuffers, found: &wgpu::Buffer) {
        if std::mem::replace(&mut self.is_saved, true) {
            return;
        }
        let GpuContact { buffers, checkpoint, .. } = &*self;
        let now = [&buffers.tracks, &cloth.x, &cloth.p, found];
        let before = [&checkpoint.tracks, &checkpoint.cloth.x, &checkpoint.cloth.p, &checkpoint.found];
        now.into_iter().zip(before).for_each(|(now, before)| encoder.copy_buffer_to_buffer(now, 0, before, 0, before.size()));
        self.copy_pairs(encoder, self.current(), (&checkpoint.pairs, 0, checkpoint.room));
    }

    /// Goes back to where the last step began, which was good.
    pub(crate) fn undo(&mut self, gpu: &Gpu, cloth: &StateBuffers, found: &wgpu::Buffer) {
        self.on_cpu.roll_back();
        self.status = self.before;
        self.roll_back(gpu);
        let mut encoder = gpu.encoder();
        let before = [&self.checkpoint.cloth.x, &self.checkpoint.cloth.p, &self.checkpoint.found];
        let now = [&cloth.x, &cloth.p, found];
        before.into_iter().zip(now).for_each(|(before, now)| encoder.copy_buffer_to_buffer(before, 0, now, 0, before.size()));
        gpu.queue().submit([encoder.finish()]);
    }

    /// Rolls contact back to the saved state, after an attempt.
    pub(crate) fn roll_back(&mut self, gpu: &Gpu) {
        let GpuContact { buffers, checkpoint, room, .. } = &*self;
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(&checkpoint.tracks, 0, &buffers.tracks, 0, checkpoint.tracks.size());
        self.copy_pairs(&mut encoder, (&checkpoint.pairs, 0, checkpoint.room), (&buffers.pairs, 0, *room));
        gpu.queue().submit([encoder.finish()]);
        self.status.half = 0;
    }

    /// Rolls back, and makes room for twice the needed pairs and space if the device allows it: folding cloth soon needs more
    /// again. What is sufficient is kept.
    pub(super) fn grow(&mut self, gpu: &Gpu, needed: usize, space: usize) {
        let grown =
            |now, needed: usize, most| if needed > now { (2 * needed).next_multiple_of(WORKGROUP).min(most) } else { now };
        let [most_room, most_space] = self.most(gpu);
        let room = grown(self.room, needed, most_room);
        self.make_room(gpu, room, grown(self.space, space, most_space));
        self.roll_back(gpu);
        (self.checkpoint.pairs, self.checkpoint.room) = (Checkpoint::pairs(gpu, self.room), self.room);
        self.is_saved = false;
    }

    /// Replaces the list by an empty one with room for this many pairs, and with this space for what detection compares.
    pub(crate) fn make_room(&mut self, gpu: &Gpu, room: usize, space: usize) {
        self.buffers.pairs = gpu.buffer("pairs", (2 * room * size_of::<Listed>()) as u64);
        self.buffers.near = gpu.buffer("near pairs", (NEAR * room).max(SPACE * space) as u64);
        (self.room, self.space, self.stages) = (room, space, None);
    }

    /// Notes how mesh colliders move in the step.
    pub(crate) fn note_meshes(&mut self, plan: &Plan<'_>) {
        self.before = self.status;
        if self.on_cpu.begin(plan, self.params.friction) {
            self.status.since = NEVER;
        }
    }

    /// Starts a step: uploads the motion of mesh colliders and chooses the kernels of the first attempt, which saves the state.
    pub(crate) fn begin(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        if let Some(motions) = self.on_cpu.motions(plan) {
            gpu.write(&self.buffers.tracks, TRACK * self.params.all_vertices as usize, motions);
        }
        self.substeps = plan.substeps.len();
        self.choice.begin(&self.status, self.substeps);
        (self.is_saved, self.max_carry) = (false, 0.0);
        (self.covers_stops, self.may_cover_stops) = (false, true);
    }

    /// Waits for the result of an attempt, and rolls back unless it is good; `end` reads the positions (m) of the cloth after it.
    ///
    /// If contact stopped something so suddenly that what followed it got through, without having been listed, the step must be
    /// attempted again with all pairs listed that may meet.
    pub(crate) fn judge(
        &mut self,
        gpu: &Gpu,
        plan: &Plan<'_>,
        end: impl FnOnce() -> Result<Vec<Vec4>, GpuFault>,
    ) -> Result<Judgment, GpuFault> {
        let readback: StatusReadback = gpu.mapped(&self.staging, bytemuck::pod_read_unaligned)?;
        let status = readback.status;
        let (needed, space) = (status.needed as usize, status.space_needed as usize);
        let has = |reason| status.stopped & reason != 0;
        let [most_room, most_space] = self.most(gpu);
        if has(CROWDED) || needed > most_room || space > most_space {
            self.roll_back(gpu);
            if std::mem::take(&mut self.covers_stops) {
                return Ok(Judgment::Again);
            }
            self.on_cpu.roll_back();
            self.status.since = self.before.since;
            let candidates = status.candidates.saturating_add(status.edge_candidates);
            let most = status.needed.max(status.listed).max(candidates).max(status.leaf_pairs);
            return Ok(Judgment::Crowded(most as usize));
        }
        if !has(NO_ROOM | EARLY | CLOSE | RUN_OVER) {
            let (through, have_all_through) = noted(&readback.through, status.through);
            let (pinched, have_all_pinched) = noted(&readback.pinched, status.pinched);
            let (mut drifted, mut have_all_drifted) = noted(&readback.drifted, status.drifted);
            if status.drifted > 0 && status.through == 0 && self.may_cover_stops && !self.on_cpu.must_search() {
                if self.on_cpu.have_arisen(plan, end()?, have_all_drifted.then_some(drifted)) {
                    (self.covers_stops, self.may_cover_stops) = (true, false);
                    self.choice.change(EARLY, false);
                    self.roll_back(gpu);
                    return Ok(Judgment::Again);
                }
                (drifted, have_all_drifted) = (&[], true);
            }
            self.status = status.at_end(self.substeps);
            let are_all = have_all_through && have_all_pinched && have_all_drifted && status.jumped == 0;
            self.on_cpu.note_pinched([through, pinched], drifted, are_all);
            return Ok(Judgment::Good);
        }
        self.choice.change(status.stopped, needed > 0);
        // The common motion differs a little from substep to substep.
        self.max_carry = self.max_carry.max(1.25 * f32::from_bits(status.needed_carry));
        if needed > self.room || space > self.space {
            self.grow(gpu, needed, space);
        } else {
            self.roll_back(gpu);
        }
        Ok(Judgment::Again)
    }

    /// The largest number of pairs to have room for, in both halves of the list, and the largest space for what detection
    /// compares: as much as the CPU lists, if the device allows it.
    fn most(&self, gpu: &Gpu) -> [usize; 2] {
        let most = max_listed(self.params.all_vertices as usize);
        [2 * size_of::<Listed>(), SPACE].map(|bytes| most.min(gpu.most_table_bytes() / bytes))
    }

    /// Encodes a copy of the status after the step's commands.
    pub(crate) fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_buffer_to_buffer(&self.buffers.contact_state, 0, &self.staging, 0, size_of::<StatusReadback>() as u64);
    }
}
