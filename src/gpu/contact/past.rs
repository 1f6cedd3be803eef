//! Reads and writes the part of contact's state that snapshots save.

use super::GpuContact;
use super::status::{Listed, NEVER, Status, Track};
use crate::contact::Past;
use crate::contact::device::{DeviceLists, DevicePair};
use crate::device::Gpu;
use crate::device::fault::GpuFault;

impl GpuContact {
    /// Reads the state. Waits for the GPU.
    pub(crate) fn past(&self, gpu: &Gpu) -> Result<Past, GpuFault> {
        let Status { half, listed, since, ahead, h, .. } = self.status;
        if since < 0.0 {
            return Ok(self.kept.past(&DeviceLists { h, ..DeviceLists::default() }));
        }
        let (tracks, pair) = (&self.buffers.tracks, size_of::<Listed>() as u64);
        let rows = 4 * (u64::from(self.table.rows) + 1);
        let sizes = [tracks.size(), rows, u64::from(listed) * pair];
        let staging = gpu.staging("contact so far", sizes.iter().sum());
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(tracks, 0, &staging, 0, sizes[0]);
        encoder.copy_buffer_to_buffer(&self.buffers.starts, u64::from(half) * rows, &staging, sizes[0], rows);
        if listed > 0 {
            let first = u64::from(half) * self.room as u64 * pair;
            encoder.copy_buffer_to_buffer(&self.buffers.pairs, first, &staging, sizes[0] + rows, sizes[2]);
        }
        gpu.queue().submit([encoder.finish()]);
        gpu.mapped(&staging, |bytes| {
            let (tracks, rest) = bytes.split_at(sizes[0] as usize);
            let (starts, pairs) = rest.split_at(rows as usize);
            let tracks: Vec<Track> = bytemuck::pod_collect_to_vec(tracks);
            let pairs: Vec<Listed> = bytemuck::pod_collect_to_vec(pairs);
            let pair =
                |&Listed { corners, lambda, other, thickness, .. }: &Listed| DevicePair { corners, other, thickness, lambda };
            self.kept.past(&DeviceLists {
                starts: bytemuck::pod_collect_to_vec(starts),
                pairs: pairs.iter().map(pair).collect(),
                from: tracks.iter().map(|track| track.start).collect(),
                by: tracks.iter().map(|track| track.by).collect(),
                ahead,
                since: Some(since),
                h,
            })
        })
    }

    /// Continues from a saved state. Returns false, and changes nothing, if the state cannot belong to this cloth.
    pub(crate) fn resume(&mut self, gpu: &Gpu, past: &Past) -> bool {
        let Some(lists) = self.kept.resume(past) else { return false };
        let DeviceLists { starts, pairs, from, by, ahead, since, h } = lists;
        if pairs.len() > self.room {
            self.grow(gpu, pairs.len());
        }
        let all: Vec<Listed> = pairs
            .iter()
            .map(|&DevicePair { corners, other, thickness, lambda }| Listed {
                corners,
                lambda,
                other,
                thickness,
                padding: [0; 2],
            })
            .collect();
        let tracks: Vec<Track> = from.iter().zip(&by).map(|(&start, &by)| Track { start, by }).collect();
        gpu.write(&self.buffers.starts, 0, &vec![0_u32; self.table.rows as usize + 1]);
        gpu.write(&self.buffers.starts, 0, &starts);
        gpu.write(&self.buffers.pairs, 0, &all);
        gpu.write(&self.buffers.tracks, 0, &tracks);
        let with_vertices = starts.get(self.table.first_edge as usize).copied().unwrap_or_default();
        self.status =
            Status { listed: all.len() as u32, with_vertices, since: since.unwrap_or(NEVER), ahead, h, ..Status::nothing() };
        true
    }
}
