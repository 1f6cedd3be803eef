//! The attempts of a step: saves the state before them, judges each, and rolls back if another is necessary.

use super::status::{CLOSE, CROWDED, EARLY, Listed, NEAR, NO_ROOM, Status};
use super::{GpuContact, leaf_lists};
use crate::device::Gpu;
use crate::device::fault::GpuFault;
use crate::gpu::stage::WORKGROUP;

impl GpuContact {
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

    /// Rolls back, and makes room for twice the needed pairs if the device allows it: folding cloth soon needs more again.
    pub(super) fn grow(&mut self, gpu: &Gpu, needed: usize) {
        let room = (2 * needed).next_multiple_of(WORKGROUP).min(most_room(gpu));
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

    /// Replaces the lists of leaves by empty ones with room for this many leaves each.
    pub(crate) fn make_room_of_leaf(&mut self, gpu: &Gpu, room: usize) {
        self.buffers.beside = leaf_lists(gpu, &self.table, room);
        (self.room_of_leaf, self.stages) = (room, None);
    }

    /// Starts a step: chooses the kernels of the first attempt and saves the state.
    pub(crate) fn begin(&mut self, gpu: &Gpu, substeps: usize) {
        self.substeps = substeps;
        self.course.begin(&self.status, substeps);
        self.keep(gpu);
    }

    /// Waits for the result of an attempt. Returns whether the step must be attempted again, from the state to which it
    /// was rolled back. An inner error is the number of pairs, if these were too many.
    pub(crate) fn judge(&mut self, gpu: &Gpu) -> Result<Result<bool, usize>, GpuFault> {
        let status: Status = gpu.mapped(&self.staging, bytemuck::pod_read_unaligned)?;
        let needed = status.needed as usize;
        let has = |reason| status.stopped & reason != 0;
        let of_leaf = status.needed_of_leaf as usize;
        let most_of_leaf = gpu.most_table_bytes() / (8 << self.table.depth);
        if has(CROWDED) || needed > most_room(gpu) || of_leaf > most_of_leaf {
            self.go_back(gpu);
            self.forget();
            return Ok(Err(needed.max(status.listed as usize)));
        }
        if !has(NO_ROOM | EARLY | CLOSE) {
            self.status = status.at_end(self.substeps);
            return Ok(Ok(false));
        }
        self.course.change(status.stopped, needed > 0);
        if of_leaf > self.room_of_leaf {
            self.make_room_of_leaf(gpu, of_leaf + of_leaf / 2);
        }
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
}

/// The largest number of pairs that the device allows room for, in both halves of the list.
fn most_room(gpu: &Gpu) -> usize {
    gpu.most_table_bytes() / (2 * size_of::<Listed>())
}
