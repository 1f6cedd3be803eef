//! Reads and writes the part of contact's state that snapshots save.

use std::ops::Range;

use glam::Vec4;

use super::GpuContact;
use super::kernel_choice::KernelChoice;
use super::status::{Listed, NEVER, Status, TRACK, Track};
use crate::contact::ContactPast;
use crate::contact::detection::paths::Paths;
use crate::contact::detection::rows::Rows;
use crate::device::Gpu;
use crate::device::fault::GpuFault;

impl GpuContact {
    /// Reads the state. Waits for the GPU.
    pub(crate) fn past(&self, gpu: &Gpu) -> Result<ContactPast, GpuFault> {
        let Status { since, ahead, h, listed, .. } = self.status;
        if since < 0.0 && listed == 0 {
            return Ok(self.on_cpu.past(Default::default(), Paths::default(), h));
        }
        let (tracks, paths) = (&self.buffers.tracks, (TRACK * self.params.all_vertices as usize) as u64);
        let staging = gpu.staging("contact so far", paths + (listed as usize * size_of::<Listed>()) as u64);
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(tracks, 0, &staging, 0, paths);
        self.copy_pairs(&mut encoder, self.current(), (&staging, paths, listed as usize));
        gpu.queue().submit([encoder.finish()]);
        gpu.mapped(&staging, |bytes| {
            let (tracks, pairs) = bytes.split_at(paths as usize);
            let tracks: Vec<Track> = bytemuck::pod_collect_to_vec(tracks);
            let mut pairs: Vec<Listed> = bytemuck::pod_collect_to_vec(pairs);
            // The GPU's list has no order.
            pairs.sort_unstable_by_key(|pair| (pair.row, pair.other));
            let rows = |rows: Range<u32>| {
                let start = |row| pairs.partition_point(|pair| pair.row < row);
                let pairs = &pairs[start(rows.start)..start(rows.end)];
                let starts = (rows.start..=rows.end).map(|row| pairs.partition_point(|pair| pair.row < row) as u32).collect();
                let lambda = pairs.iter().map(|pair| pair.lambda).collect();
                Rows { starts, later: Vec::new(), pairs: pairs.iter().map(Listed::pair).collect(), lambda }
            };
            let paths = Paths {
                from: tracks.iter().map(|track| track.start).collect(),
                by: tracks.iter().map(|track| track.by).collect(),
                margin: tracks.iter().map(|track| track.start.w).collect(),
                ahead,
                since: (since >= 0.0).then_some(since),
                renewed: 0,
            };
            let vertices = self.params.all_vertices;
            self.on_cpu.past([rows(0..vertices), rows(vertices..self.params.rows)], paths, h)
        })
    }

    /// Continues from a saved state. Returns false, and changes nothing, if the state cannot belong to this cloth.
    ///
    /// # Errors
    /// If its list of pairs exceeds a limit of the device; nothing has changed then. Without memory for it, the list is lost.
    pub(crate) fn resume(&mut self, gpu: &Gpu, past: &ContactPast) -> Result<bool, GpuFault> {
        gpu.meets("the list of pairs in contact", (2 * past.pairs() * size_of::<Listed>()) as u64)?;
        let Some(lists) = self.on_cpu.resume(past) else { return Ok(false) };
        let [with_vertices, with_edges] = lists.each_ref().map(|rows| rows.pairs.len() as u32);
        let listed = with_vertices + with_edges;
        if listed as usize > self.room {
            self.grow(gpu, listed as usize, 0);
        }
        let Paths { from, by, margin, ahead, since, renewed: _ } = &past.paths;
        let since = since.unwrap_or(NEVER);
        self.choice = KernelChoice::default();
        self.status = Status { listed, with_vertices, with_edges, since, ahead: *ahead, h: past.h, ..Status::nothing() };
        for ((place, first), rows) in self.places(self.room).into_iter().zip([0, self.params.all_vertices]).zip(&lists) {
            let pairs = rows.pairs.iter().zip(&rows.lambda).zip(rows.row_of_each());
            let pairs: Vec<Listed> = pairs.map(|((&pair, &lambda), row)| Listed::of(pair, lambda, first + row)).collect();
            gpu.write(&self.buffers.pairs, place.start as usize, &pairs);
        }
        let path = |((start, &margin), &by): ((&Vec4, &f32), &Vec4)| Track { start: start.with_w(margin), by };
        let tracks: Vec<Track> = from.iter().zip(margin).zip(by).map(path).collect();
        gpu.write(&self.buffers.tracks, 0, &tracks);
        Ok(true)
    }
}
