//! What bending in a single pass needs around the tiles of a sweep: more vertices, and the entries of each.

use crate::device::Gpu;
use crate::gpu::bend_tiles::surrounded;
use crate::gpu::stage::{NONE, lanes};
use crate::gpu::tiles::{IN_TILE, Tiles};
use crate::kernels::bending::BendEntry;
use crate::model::csr::Csr;

/// Bytes of workgroup memory for a moment and its couple.
const OF_MOMENT: usize = 24;
/// Most entries of a vertex. Every vertex has room for as many as any has.
const WIDEST: usize = 16;

/// The entries of the vertices in each tile, in the form that `stages/bent_tile.wgsl` reads.
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

/// Appends the entries of vertices of a tile, with room for `bent` vertices with `ring` entries each. What is left is filled with
/// entries that refer to the vertex itself and have no effect. `place` has the places of the tile's vertices.
fn push_entries(vertices: &[u32], entries: &Csr<BendEntry>, [bent, ring]: [usize; 2], place: &[u32], table: &mut Vec<u32>) {
    for index in 0..ring {
        let words = |k: usize| match vertices.get(k).and_then(|&vertex| entries.of(vertex).get(index)) {
            Some(entry) => [place[entry.other as usize], entry.forward.to_bits(), entry.backward.to_bits()],
            None => [k as u32, 0, 0],
        };
        (0..3).for_each(|word| table.extend((0..bent).map(|k| words(k)[word])));
    }
}

/// Adds to each tile the vertices whose moments act on those that it sweeps, and the ring around these. `None` if some
/// tile would have no room, or more vertices than a workgroup has invocations.
pub(crate) fn with_rings(gpu: &Gpu, tiles: &Tiles, entries: &Csr<BendEntry>) -> Option<(Tiles, Rings)> {
    let mut place = vec![NONE; entries.spans.len()];
    // The vertices of each tile: first those that are swept, then those whose moments also act on these, then those on which the
    // moments depend; and the ends of the first two parts.
    let with_ring = |list: &[u32]| {
        let (vertices, ends) = surrounded(list.to_vec(), entries, 1, usize::MAX, &mut place)?;
        vertices.iter().for_each(|&vertex| place[vertex as usize] = NONE);
        Some((vertices, ends))
    };
    let parts: Vec<(Vec<u32>, Vec<usize>)> = tiles.lists().map(with_ring).collect::<Option<_>>()?;
    let ring = entries.spans.iter().map(|span| (span.end - span.start) as usize).max()?;
    let [swept, bent] = [0, 1].map(|part| parts.iter().map(|(_, ends)| ends[part]).max().unwrap_or(0));
    let room = parts.iter().map(|(vertices, _)| vertices.len()).max()?;
    let words = 3 * ring * bent * parts.len();
    let fits = room <= lanes(gpu, room)
        && IN_TILE * room + OF_MOMENT * bent <= gpu.workgroup_memory()
        && ring <= WIDEST
        && size_of::<u32>() * words + tiles.bytes() <= gpu.most_table_bytes();
    fits.then(|| {
        let mut table = Vec::with_capacity(words);
        for (vertices, ends) in &parts {
            vertices.iter().zip(0..).for_each(|(&vertex, k)| place[vertex as usize] = k);
            push_entries(&vertices[..ends[1]], entries, [bent, ring], &place, &mut table);
        }
        let lists: Vec<Vec<u32>> = parts.into_iter().map(|(vertices, _)| vertices).collect();
        (tiles.with_lists(&lists, room), Rings { table, swept, bent, ring })
    })
}
