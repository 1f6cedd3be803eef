//! The cloth cut into tiles for bending: each with the rings around it that its own vertices depend on through the passes.

use glam::Vec4;

use crate::gpu::tiles::{TileSize, halve};
use crate::kernels::bending::BendEntry;
use crate::model::csr::Csr;

/// No place in the tile: `NO_PLACE` of `stages/bend_tile.wgsl`.
pub(crate) const NO_PLACE: u32 = u32::MAX;
/// Vertices held for each one of the cloth, at most: more recomputed is no gain.
const MOST_HELD: usize = 12;

/// Tiles as `stages/bend_tile.wgsl` reads them.
#[derive(Debug)]
pub(crate) struct BendTiles {
    /// For each tile how many vertices are its own, how many it holds, and where these are listed; then the lists.
    pub table: Vec<u32>,
    pub count: usize,
    /// Most vertices that a tile holds.
    pub largest: usize,
}

impl BendTiles {
    /// Cuts the cloth into tiles that hold `rings` rings beside their own vertices; smaller ones where they would not fit. `None` if
    /// that would be too much, as about the hub of a fan.
    pub(crate) fn new(rest: &[Vec4], entries: &Csr<BendEntry>, rings: usize, most: TileSize) -> Option<BendTiles> {
        let mut sizes = (0..3).map(|half| most.own >> half).filter(|&own| own > 0);
        sizes.find_map(|own| BendTiles::cut(rest, entries, rings, TileSize { own, ..most }))
    }

    fn cut(rest: &[Vec4], entries: &Csr<BendEntry>, rings: usize, most: TileSize) -> Option<BendTiles> {
        let mut pieces = Vec::new();
        halve((0..rest.len() as u32).collect(), rest, most.own, &mut pieces);
        let mut place = vec![NO_PLACE; rest.len()];
        let mut tiles = BendTiles { table: vec![0; 3 * pieces.len()], count: pieces.len(), largest: 0 };
        let mut held = 0;
        for (tile, own) in pieces.into_iter().enumerate() {
            let count = own.len();
            let vertices = with_rings(own, entries, rings, most.room, &mut place)?;
            held += vertices.len();
            if held > MOST_HELD * rest.len().max(256) {
                return None;
            }
            tiles.largest = tiles.largest.max(vertices.len());
            let list = tiles.table.len();
            tiles.table[3 * tile..3 * tile + 3].copy_from_slice(&[count as u32, vertices.len() as u32, list as u32]);
            let mut places = list + 2 * vertices.len();
            for &vertex in &vertices {
                tiles.table.extend([vertex, places as u32]);
                places += entries.of(vertex).len();
            }
            for &vertex in &vertices {
                tiles.table.extend(entries.of(vertex).iter().map(|entry| place[entry.other as usize]));
            }
            vertices.iter().for_each(|&vertex| place[vertex as usize] = NO_PLACE);
        }
        Some(tiles)
    }
}

/// Some vertices and so many rings around them, if there is room. `place` is of none before, and says where each is after.
fn with_rings(own: Vec<u32>, entries: &Csr<BendEntry>, rings: usize, room: usize, place: &mut [u32]) -> Option<Vec<u32>> {
    let mut vertices = own;
    vertices.iter().zip(0..).for_each(|(&vertex, k)| place[vertex as usize] = k);
    let mut ring = 0..vertices.len();
    for _ in 0..rings {
        for k in ring.clone() {
            for entry in entries.of(vertices[k]) {
                if place[entry.other as usize] == NO_PLACE {
                    place[entry.other as usize] = vertices.len() as u32;
                    vertices.push(entry.other);
                }
            }
            if vertices.len() > room {
                return None;
            }
        }
        ring = ring.end..vertices.len();
    }
    Some(vertices)
}
