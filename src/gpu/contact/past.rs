//! Reads and writes the part of contact's state that snapshots save.

use std::ops::Range;

use super::GpuContact;
use super::status::{Listed, NEVER, Status, TRACK, Track};
use crate::contact::ContactPast;
use crate::contact::device::{DeviceLists, DevicePair};
use crate::device::Gpu;
use crate::device::fault::GpuFault;

impl GpuContact {
    /// Reads the state. Waits for the GPU.
    pub(crate) fn past(&self, gpu: &Gpu) -> Result<ContactPast, GpuFault> {
        let Status { half, since, ahead, h, listed, .. } = self.status;
        if since < 0.0 && listed == 0 {
            return Ok(self.on_cpu.past(&DeviceLists { h, ..DeviceLists::default() }));
        }
        let (tracks, paths) = (&self.buffers.tracks, (TRACK * self.params.all_vertices as usize) as u64);
        let [with_vertices, with_edges] = self.places(self.room);
        let bytes = |place: &Range<u64>| place.end - place.start;
        let staging = gpu.staging("contact so far", paths + bytes(&with_vertices) + bytes(&with_edges));
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(tracks, 0, &staging, 0, paths);
        let (mut end, first) = (paths, u64::from(half) * (self.room * size_of::<Listed>()) as u64);
        for place in [with_vertices, with_edges].into_iter().filter(|place| !place.is_empty()) {
            encoder.copy_buffer_to_buffer(&self.buffers.pairs, first + place.start, &staging, end, bytes(&place));
            end += bytes(&place);
        }
        gpu.queue().submit([encoder.finish()]);
        gpu.mapped(&staging, |bytes| {
            let (tracks, pairs) = bytes.split_at(paths as usize);
            let tracks: Vec<Track> = bytemuck::pod_collect_to_vec(tracks);
            let mut pairs: Vec<Listed> = bytemuck::pod_collect_to_vec(pairs);
            // The GPU's list has no order.
            pairs.sort_unstable_by_key(|pair| (pair.row, pair.other));
            let pair =
                |&Listed { corners, lambda, other, thickness, .. }: &Listed| DevicePair { corners, other, thickness, lambda };
            let start = |row| pairs.partition_point(|pair| pair.row < row) as u32;
            self.on_cpu.past(&DeviceLists {
                starts: (0..=self.params.rows).map(start).collect(),
                pairs: pairs.iter().map(pair).collect(),
                from: tracks.iter().map(|track| track.start).collect(),
                by: tracks.iter().map(|track| track.by).collect(),
                ahead,
                since: (since >= 0.0).then_some(since),
                h,
            })
        })
    }

    /// Continues from a saved state. Returns false, and changes nothing, if the state cannot belong to this cloth.
    ///
    /// # Errors
    /// If the device has no room for its pairs; nothing has changed then.
    pub(crate) fn resume(&mut self, gpu: &Gpu, past: &ContactPast) -> Result<bool, GpuFault> {
        gpu.meets("the list of pairs in contact", (2 * past.pairs() * size_of::<Listed>()) as u64)?;
        let Some(lists) = self.on_cpu.resume(past) else { return Ok(false) };
        let DeviceLists { starts, pairs, from, by, ahead, since, h } = lists;
        if pairs.len() > self.room {
            self.grow(gpu, pairs.len(), 0);
        }
        let rows = starts.windows(2).zip(0..).flat_map(|(row, number)| (row[0]..row[1]).map(move |_| number));
        let pair =
            |(&DevicePair { corners, other, thickness, lambda }, row)| Listed { corners, lambda, other, thickness, row, next: 0 };
        let all: Vec<Listed> = pairs.iter().zip(rows).map(pair).collect();
        let tracks: Vec<Track> = from.iter().zip(&by).map(|(&start, &by)| Track { start, by }).collect();
        let with_vertices = starts.get(self.params.all_vertices as usize).copied().unwrap_or_default();
        let (listed, with_edges) = (all.len() as u32, all.len() as u32 - with_vertices);
        let since = since.unwrap_or(NEVER);
        self.status = Status { listed, with_vertices, with_edges, since, ahead, h, ..Status::nothing() };
        let (first, second) = all.split_at(with_vertices as usize);
        for (place, pairs) in self.places(self.room).into_iter().zip([first, second]) {
            gpu.write(&self.buffers.pairs, place.start as usize, pairs);
        }
        gpu.write(&self.buffers.tracks, 0, &tracks);
        Ok(true)
    }
}
