//! What the correction by a single level needs around the tiles of a sweep: the tiles of that level.

use crate::device::Gpu;
use crate::gpu::stage::lanes;
use crate::gpu::tiles::{IN_LEVEL_TILE, Tiles};
use crate::model::csr::distinct;
use crate::multigrid::hierarchy::Level;

/// For each tile one of the level, whose own aggregates are those of the tile's vertices; and the tiles with their vertices'
/// aggregates by their places in it. `None` if some tile would have no room, or more vertices than a workgroup has
/// invocations.
pub(crate) fn with_level(gpu: &Gpu, tiles: &Tiles, level: &Level) -> Option<(Tiles, Tiles)> {
    let lists: Vec<&[u32]> = tiles.lists().collect();
    let aggregates = |list: &&[u32]| distinct(list.iter().map(|&vertex| level.label[vertex as usize]).collect());
    let own: Vec<Vec<u32>> = lists.iter().map(aggregates).collect();
    let room = gpu.workgroup_memory() / IN_LEVEL_TILE;
    let of_level = Tiles::around(&own, level.inverse_mass.len(), &level.links, &level.colors, room)?;
    let invocations = lanes(gpu, tiles.largest);
    let fits = tiles.largest <= invocations.min(room) && tiles.bytes() + of_level.bytes() <= gpu.most_table_bytes();
    fits.then(|| {
        // Vertices and aggregates are held in the same memory, one after the other.
        let room = tiles.largest.max(of_level.largest);
        let mut tiles = tiles.with_lists(&lists, room);
        tiles.set_places(&level.label, &of_level);
        (tiles, of_level)
    })
}
