//! What bending in a single pass needs around the tiles of a sweep: more vertices, and the entries of each.

use crate::device::Gpu;
use crate::gpu::stage::lanes;
use crate::gpu::tiles::{TileSize, Tiles};
use crate::kernels::bending::BendEntry;
use crate::model::csr::Csr;

/// Bytes of workgroup memory per vertex with a moment: the moment and its couple.
const IN_TILE: usize = 24;
/// Most entries of a vertex. Every vertex has room for as many as any has.
const WIDEST: usize = 16;

/// The entries of the vertices in each tile, in the form that `stages/bent_tile.wgsl` reads.
#[derive(Debug)]
pub(crate) struct Rings {
    /// For each tile, for each entry of a vertex: the other vertices by their places in the tile, one for each vertex
    /// with a moment, then the forward coefficients, then the backward ones.
    pub table: Vec<u32>,
    /// Most vertices of a tile that are swept, and that have moments.
    pub swept: usize,
    pub bent: usize,
    /// Most entries of a vertex.
    pub ring: usize,
}

/// Adds to each tile the vertices whose moments act on those that it sweeps, and the ring around these. `None` if some
/// tile would have no room, or more vertices than a workgroup has invocations.
pub(crate) fn with_rings(gpu: &Gpu, tiles: &Tiles, entries: &Csr<BendEntry>, most: TileSize) -> Option<(Tiles, Rings)> {
    let ring = (0..entries.spans.len()).map(|v| entries.of(v as u32).len()).max()?;
    let mut place = vec![None; entries.spans.len()];
    let (mut lists, mut bent) = (Vec::new(), Vec::new());
    for mut vertices in tiles.lists() {
        vertices.iter().zip(0..).for_each(|(&vertex, k)| place[vertex as usize] = Some(k));
        let mut start = 0;
        for _ in 0..2 {
            let end = vertices.len();
            bent.push(end);
            for k in start..end {
                for entry in entries.of(vertices[k]) {
                    place[entry.other as usize].get_or_insert_with(|| {
                        vertices.push(entry.other);
                        vertices.len() as u32 - 1
                    });
                }
            }
            start = end;
        }
        vertices.iter().for_each(|&vertex| place[vertex as usize] = None);
        lists.push(vertices);
    }
    // Of each tile, the number of vertices that are swept and of those with moments.
    let most_of = |which: usize| bent.chunks(2).map(|ends| ends[which]).max().unwrap_or(0);
    let (swept, bent_most) = (most_of(0), most_of(1));
    let room = lists.iter().map(Vec::len).max()?;
    let words = 3 * ring * bent_most * lists.len();
    let fits = room <= most.room.min(lanes(gpu, room))
        && IN_TILE * bent_most + crate::gpu::engine::IN_TILE * room <= gpu.workgroup_memory()
        && ring <= WIDEST
        && size_of::<u32>() * words + tiles.bytes() <= most.bytes;
    if !fits {
        return None;
    }
    let mut table = Vec::with_capacity(words);
    for (vertices, ends) in lists.iter().zip(bent.chunks(2)) {
        vertices.iter().zip(0..).for_each(|(&vertex, k)| place[vertex as usize] = Some(k));
        for index in 0..ring {
            let entry = |k: usize| {
                let entry = (k < ends[1]).then(|| entries.of(vertices[k]).get(index)).flatten();
                entry.map_or([k as u32, 0, 0], |entry| {
                    [place[entry.other as usize].unwrap_or(0), entry.forward.to_bits(), entry.backward.to_bits()]
                })
            };
            (0..3).for_each(|word| table.extend((0..bent_most).map(|k| entry(k)[word])));
        }
        vertices.iter().for_each(|&vertex| place[vertex as usize] = None);
    }
    Some((tiles.with_lists(&lists, room), Rings { table, swept, bent: bent_most, ring }))
}
