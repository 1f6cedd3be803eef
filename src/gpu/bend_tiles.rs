//! Tiles of the cloth for bending. Each includes the rings around its own vertices on which they depend through the
//! passes.

use glam::Vec4;

use crate::gpu::slices::push_slices;
use crate::gpu::stage::NONE;
use crate::gpu::tiles::{TileSize, cut_into_pieces};
use crate::kernels::bending::BendEntry;
use crate::model::csr::Csr;
use crate::multigrid::hierarchy::Level;

/// Words of the table for each tile, before the lists.
const HEADER: usize = 4;
/// Limit on the vertices in all tiles per vertex of the cloth. With more, recomputing them costs more than it saves.
const MAX_HELD: usize = 12;

/// Tiles in the layout that `stages/bend_tile.wgsl` reads.
pub(crate) struct BendTiles {
    /// For each tile, the words at which the list of its rings, the list of its vertices, the slices of their entries and
    /// its aggregates start; then these. The list of rings has their number, the number of the tile's own vertices, and
    /// the number of vertices up to the end of each ring. The list of vertices has one more ring, which the outermost one
    /// reads. Entries refer to vertices by their positions in that list. If a level is averaged too, each tile has whole
    /// aggregates of it: their number, each with the position of its first vertex, the number of vertices, then for each
    /// vertex the position of its aggregate's first one and its share of the aggregate's mass.
    pub table: Vec<u32>,
    pub count: usize,
    /// Most vertices of a tile: those with moments, and all.
    pub largest: usize,
    pub longest: usize,
}

impl BendTiles {
    /// Divides the cloth into tiles with `rings` rings around their own vertices, and into smaller tiles where these
    /// would not fit. `None` if the tiles hold too many vertices, as around the hub of a fan.
    pub(crate) fn new(
        rest: &[Vec4],
        entries: &Csr<BendEntry>,
        rings: usize,
        most: TileSize,
        level: Option<&Level>,
    ) -> Option<BendTiles> {
        let mut sizes = (0..3).map(|half| most.own >> half).filter(|&own| own > 0);
        sizes.find_map(|own| BendTiles::cut(rest, entries, rings, TileSize { own, ..most }, level))
    }

    fn cut(rest: &[Vec4], entries: &Csr<BendEntry>, rings: usize, most: TileSize, level: Option<&Level>) -> Option<BendTiles> {
        let mut groups = Vec::new();
        let pieces: Vec<Vec<u32>> = match level {
            None => {
                let around = |vertex: u32| entries.of(vertex).iter().map(move |entry| [vertex, entry.other]);
                cut_into_pieces(rest, (0..rest.len() as u32).flat_map(around), most.own)
            }
            Some(level) => {
                let size = rest.len().div_ceil(level.members.spans.len()).max(1);
                let firsts: Vec<Vec4> =
                    level.members.spans.iter().map(|span| rest[level.members.items[span.start as usize] as usize]).collect();
                groups = cut_into_pieces(&firsts, level.links.iter().map(|link| link.ends), most.own.div_ceil(size));
                let own = |group: &Vec<u32>| group.iter().flat_map(|&aggregate| level.members.of(aggregate)).copied().collect();
                groups.iter().map(own).collect()
            }
        };
        let mut place = vec![NONE; rest.len()];
        let mut tiles = BendTiles { table: vec![0; HEADER * pieces.len()], count: pieces.len(), largest: 0, longest: 0 };
        let mut held_by_all = 0;
        for (tile, own) in pieces.into_iter().enumerate() {
            let (vertices, ends) = surrounded(own, entries, rings, most.room, &mut place)?;
            let held = ends[rings];
            held_by_all += held;
            if held_by_all > MAX_HELD * rest.len().max(256) {
                return None;
            }
            tiles.largest = tiles.largest.max(held);
            tiles.longest = tiles.longest.max(vertices.len());
            let table = &mut tiles.table;
            table[HEADER * tile] = table.len() as u32;
            table.push(rings as u32);
            table.extend(ends.iter().map(|&end| end as u32));
            table[HEADER * tile + 1] = table.len() as u32;
            table.extend(&vertices);
            table[HEADER * tile + 2] = table.len() as u32;
            push_rings(table, held, |k| entries.of(vertices[k]), |vertex| place[vertex as usize]);
            if let Some(level) = level {
                table[HEADER * tile + 3] = table.len() as u32;
                push_aggregates(table, &groups[tile], level);
            }
            vertices.iter().for_each(|&vertex| place[vertex as usize] = NONE);
        }
        (size_of_val(tiles.table.as_slice()) <= most.bytes).then_some(tiles)
    }
}

/// Appends aggregates and their vertices, as `stages/bend_tile.wgsl` reads them.
fn push_aggregates(table: &mut Vec<u32>, group: &[u32], level: &Level) {
    let (mut of_vertices, mut first) = (Vec::new(), 0);
    table.push(group.len() as u32);
    for &aggregate in group {
        table.extend([aggregate, first]);
        let span = level.members.spans[aggregate as usize];
        let shares = &level.share[span.start as usize..span.end as usize];
        of_vertices.extend(shares.iter().flat_map(|share| [first, share.to_bits()]));
        first += span.end - span.start;
    }
    table.extend([0, first]);
    table.extend(of_vertices);
}

/// Appends the entries of `count` vertices to a table, as `stages/bend_in_workgroup.wgsl` reads them. `place` is the
/// position that stands for a vertex.
pub(crate) fn push_rings<'a>(
    table: &mut Vec<u32>,
    count: usize,
    entries: impl Fn(usize) -> &'a [BendEntry],
    place: impl Fn(u32) -> u32,
) {
    let words = |entry: &BendEntry| [place(entry.other), entry.forward.to_bits(), entry.backward.to_bits()];
    // Padded with the vertex itself with coefficients of 0.
    push_slices(table, count, |k| entries(k).iter().map(words), |k| [k as u32, 0, 0]);
}

/// A tile's own vertices followed by `rings` rings around them and one more, and the number of vertices up to the end of each
/// ring but the last. `None` if there is no room for those. On return `place` has the position of each vertex.
pub(crate) fn surrounded(
    own: Vec<u32>,
    entries: &Csr<BendEntry>,
    rings: usize,
    room: usize,
    place: &mut [u32],
) -> Option<(Vec<u32>, Vec<usize>)> {
    let mut vertices = own;
    vertices.iter().zip(0..).for_each(|(&vertex, k)| place[vertex as usize] = k);
    let (mut ends, mut looked_at) = (Vec::new(), 0);
    while ends.len() <= rings && vertices.len() <= room {
        ends.push(vertices.len());
        for k in std::mem::replace(&mut looked_at, vertices.len())..vertices.len() {
            for entry in entries.of(vertices[k]) {
                if place[entry.other as usize] == NONE {
                    place[entry.other as usize] = vertices.len() as u32;
                    vertices.push(entry.other);
                }
            }
        }
    }
    (vertices.len() <= room).then_some((vertices, ends))
}
