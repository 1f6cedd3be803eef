//! Tiles: pieces of the cloth that fit into a workgroup's memory, each with everything that its own vertices depend on.
//!
//! A sweep visits the edges color after color. Going backward from a tile's own vertices: a vertex that is needed after
//! a color requires, before that color, the other end of its edge of that color. The vertices found in this way, the
//! halo, form a few rings. Computing them in every tile that needs them is cheaper than one dispatch per color: five to
//! eight times, on a device whose dispatches cost 2 us each.

use std::ops::Range;

use glam::Vec4;
use rayon::prelude::*;

use crate::HAS_THREADS;
use crate::device::Gpu;
use crate::gpu::stage::NONE;
use crate::kernels::distance::Edge;
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::link::Link;
use crate::model::mesh::bounds;

/// Bytes of workgroup memory per vertex of a tile.
pub(crate) const IN_TILE: usize = 32;
/// Bytes of workgroup memory per aggregate of a tile.
pub(crate) const IN_LEVEL_TILE: usize = 48;

/// Tiles in the form that `stages/tiles.wgsl` reads.
pub(crate) struct Tiles {
    /// First the number of own vertices of each tile. Then the vertices of each tile, its own first, in
    /// [`Tiles::largest`] words, padded with its first one; then the aggregates of those. Then the edges of each tile
    /// and color, in [`Tiles::widest`] words each: the ends as pairs of places among the tile's vertices, the inverse
    /// lengths, and the inverse weights.
    pub table: Vec<u32>,
    /// The number of vertices of each tile.
    held: Vec<usize>,
    pub count: usize,
    pub colors: usize,
    /// Most vertices in a tile, and most edges of a color in a tile.
    pub largest: usize,
    pub widest: usize,
    /// The place in the table where the edges start, and for each word from there on the cloth's edge that it belongs
    /// to.
    edges: usize,
    sources: Vec<u32>,
}

/// The allowed size of tiles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TileSize {
    /// Most own vertices, and most vertices in total.
    pub own: usize,
    pub room: usize,
    /// Most bytes of the table.
    pub bytes: usize,
}

/// A tile: its vertices, its own first, and its edges of each color.
struct Tile {
    own: usize,
    vertices: Vec<u32>,
    edges: Vec<Vec<u32>>,
}

/// The cloth that is divided into tiles.
struct Source<'a> {
    rest: &'a [Vec4],
    links: &'a [Link],
    colors: &'a [Range<usize>],
    /// The edges at each vertex.
    around: Csr<u32>,
    /// Most vertices of a tile.
    room: usize,
}

impl Tiles {
    /// Divides the cloth into tiles. `None` if that is not possible, as for a fan of many edges, or not efficient.
    /// Every tile has room for as many edges of every color as any tile has of one, so a vertex with a hundred edges
    /// makes the tables of all tiles large.
    pub(crate) fn new(rest: &[Vec4], links: &[Link], colors: &[Range<usize>], most: TileSize) -> Option<Tiles> {
        let room = most.room.min(1 << 16);
        let source = Source::new(rest, rest.len(), links, colors, room);
        let pieces = cut_into_pieces(rest, links.iter().map(|link| link.ends), most.own.min(room).max(1));
        let tiles = each_piece(pieces, rest.len(), |own, seen| source.fit(own, seen))?;
        let tiles: Vec<Tile> = tiles.into_iter().flatten().collect();
        let held: usize = tiles.iter().map(|tile| tile.vertices.len()).sum();
        // Beyond this amount of redundant computation tiles do not pay off.
        let fits = size_of::<u32>() * words(&tiles, colors.len()).iter().sum::<usize>() <= most.bytes;
        (fits && held <= 16 * rest.len().max(256)).then(|| Tiles::lay_out(&tiles, rest.len(), links, colors.len()))
    }

    /// Tiles with these own vertices, of a cloth of `count` vertices. `None` if one has more than `room` vertices.
    pub(crate) fn around(
        pieces: &[Vec<u32>],
        count: usize,
        links: &[Link],
        colors: &[Range<usize>],
        room: usize,
    ) -> Option<Tiles> {
        let source = Source::new(&[], count, links, colors, room);
        let tiles = each_piece(pieces, count, |own, seen| source.tile(own, seen))?;
        Some(Tiles::lay_out(&tiles, count, links, colors.len()))
    }

    fn lay_out(tiles: &[Tile], vertices: usize, links: &[Link], colors: usize) -> Tiles {
        let count = tiles.len();
        let (largest, widest) = (largest(tiles), widest(tiles));
        let [edges, words] = words(tiles, colors);
        let mut table = vec![NONE; edges + words];
        let mut sources = vec![NONE; words];
        let mut place = vec![0; vertices];
        for (index, tile) in tiles.iter().enumerate() {
            table[index] = tile.own as u32;
            let list = &mut table[count + index * largest..][..largest];
            list.fill(tile.vertices[0]);
            list[..tile.vertices.len()].copy_from_slice(&tile.vertices);
            tile.vertices.iter().zip(0..).for_each(|(&vertex, k)| place[vertex as usize] = k);
            for (color, list) in tile.edges.iter().enumerate() {
                let start = 3 * widest * (index * colors + color);
                for (k, &edge) in list.iter().enumerate() {
                    let [a, b] = links[edge as usize].ends.map(|vertex| place[vertex as usize]);
                    table[edges + start + k] = a | b << 16;
                    sources[start + widest + k] = edge;
                    sources[start + 2 * widest + k] = edge;
                }
            }
        }
        let held = tiles.iter().map(|tile| tile.vertices.len()).collect();
        Tiles { table, held, count, colors, largest, widest, edges, sources }
    }

    /// The vertices of each tile.
    pub(crate) fn lists(&self) -> impl Iterator<Item = &[u32]> {
        let starts = (0..self.count).map(|tile| self.count + tile * self.largest);
        starts.zip(&self.held).map(|(start, &held)| &self.table[start..start + held])
    }

    /// The same tiles with more vertices after those of each, and room for `room` in each. Labels are not kept.
    pub(crate) fn with_lists(&self, lists: &[impl AsRef<[u32]>], room: usize) -> Tiles {
        let mut table = self.table[..self.count].to_vec();
        let lists = || lists.iter().map(AsRef::as_ref);
        lists().for_each(|list| table.extend((0..room).map(|k| list.get(k).unwrap_or(&list[0]))));
        table.resize(self.count * (1 + 2 * room), NONE);
        let edges = table.len();
        table.extend(&self.table[self.edges..]);
        let (held, sources) = (lists().map(<[u32]>::len).collect(), self.sources.clone());
        Tiles { table, held, largest: room, edges, sources, ..*self }
    }

    /// Stores the aggregates of the vertices of each tile by their places in the tile of the same number of a level, whose own
    /// aggregates are these in order.
    pub(crate) fn set_places(&mut self, label: &[u32], of_level: &Tiles) {
        for tile in 0..self.count {
            let own = &of_level.table[of_level.count + tile * of_level.largest..][..of_level.table[tile] as usize];
            let start = self.count + tile * self.largest;
            let named = self.count * self.largest + start;
            for k in 0..self.largest {
                let aggregate = label[self.table[start + k] as usize];
                self.table[named + k] = own.binary_search(&aggregate).unwrap_or(0) as u32;
            }
        }
    }

    /// Bytes that a sweep reads: the table, and two vectors for each vertex of each tile.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.table.as_slice()) + 32 * self.count * self.largest
    }

    /// Stores the aggregates of the vertices, and renumbers the vertices from `base` on.
    pub(crate) fn set_labels(&mut self, labels: impl Fn(u32) -> u32, base: u32) {
        let (_, lists) = self.table[..self.edges].split_at_mut(self.count);
        let (vertices, named) = lists.split_at_mut(self.count * self.largest);
        for (vertex, label) in vertices.iter_mut().zip(named) {
            *label = labels(*vertex);
            *vertex += base;
        }
    }

    /// Stores the edges' coefficients, here and in `buffer`, where the table starts at byte `start`.
    pub(crate) fn send_edges(&mut self, gpu: &Gpu, buffer: &wgpu::Buffer, start: usize, edges: &[Edge]) {
        let width = self.widest.max(1);
        let lists = self.table[self.edges..].chunks_mut(width).zip(self.sources.chunks(width)).enumerate();
        for (list, (words, sources)) in lists.filter(|(list, _)| list % 3 > 0) {
            for (word, &source) in words.iter_mut().zip(sources) {
                let Some(edge) = edges.get(source as usize) else { continue };
                *word = if list % 3 == 1 { edge.inverse_rest } else { edge.inverse_weight }.to_bits();
            }
        }
        gpu.write(buffer, start + size_of::<u32>() * self.edges, &self.table[self.edges..]);
    }

    /// The cloth's edge that is number `k % widest` of color `k / widest`; the colors of each tile follow those of the one before.
    pub(crate) fn edge(&self, k: usize) -> usize {
        let width = self.widest.max(1);
        self.sources[3 * width * (k / width) + width + k % width] as usize
    }

    /// The constants of `stages/tiles.wgsl`, with so many invocations per workgroup.
    pub(crate) fn constants(&self, invocations: usize) -> [(&'static str, f64); 5] {
        [("LANES", invocations), ("ROOM", self.largest), ("WIDTH", self.widest), ("COLORS", self.colors), ("TILES", self.count)]
            .map(|(name, value)| (name, value as f64))
    }
}

/// What `work` returns for each piece, in parallel. It is also given room for a mark for each of `count` vertices.
fn each_piece<P: Send, T: Send>(
    pieces: impl IntoIterator<Item = P> + IntoParallelIterator<Item = P>,
    count: usize,
    work: impl Fn(P, &mut [bool]) -> Option<T> + Sync,
) -> Option<Vec<T>> {
    let marks = || vec![false; count];
    if HAS_THREADS {
        return pieces.into_par_iter().map_init(marks, |marks, piece| work(piece, marks)).collect();
    }
    let mut marks = marks();
    pieces.into_iter().map(|piece| work(piece, &mut marks)).collect()
}

/// Most vertices in a tile.
fn largest(tiles: &[Tile]) -> usize {
    tiles.iter().map(|tile| tile.vertices.len()).max().unwrap_or(0)
}

/// Most edges of a color in a tile.
fn widest(tiles: &[Tile]) -> usize {
    tiles.iter().flat_map(|tile| &tile.edges).map(Vec::len).max().unwrap_or(0)
}

/// Words of the table for this many colors: those before the edges, and those of the edges.
fn words(tiles: &[Tile], colors: usize) -> [usize; 2] {
    [tiles.len() * (1 + 2 * largest(tiles)), tiles.len() * colors * 3 * widest(tiles)]
}

/// Cuts vertices, of which these pairs depend on each other, into pieces of at most `most`, each of vertices that are close in
/// the rest shape. Connected parts are cut apart from each other: layers that lie on each other would share all pieces, and
/// each of these would have a halo in each layer. Parts that are small share a piece.
pub(super) fn cut_into_pieces(rest: &[Vec4], pairs: impl Iterator<Item = [u32; 2]>, most: usize) -> Vec<Vec<u32>> {
    let part = DisjointSets::parts(rest.len(), pairs);
    let by_part = Csr::new(rest.len(), part.iter().copied().zip(0..)).items;
    let (mut pieces, mut shared) = (Vec::new(), Vec::new());
    for part in by_part.chunk_by(|&a, &b| part[a as usize] == part[b as usize]) {
        if shared.len() + part.len() > most && !shared.is_empty() {
            halve(std::mem::take(&mut shared), rest, most, &mut pieces);
        }
        shared.extend(part);
    }
    halve(shared, rest, most, &mut pieces);
    pieces
}

/// Cuts a set of vertices across its longest extent until each piece has at most `most`.
fn halve(mut set: Vec<u32>, rest: &[Vec4], most: usize, pieces: &mut Vec<Vec<u32>>) {
    if set.len() <= most {
        set.sort_unstable();
        pieces.push(set);
        return;
    }
    let [low, high] = cut(set, rest);
    halve(low, rest, most, pieces);
    halve(high, rest, most, pieces);
}

/// The two halves of a set of vertices, cut across its longest extent.
fn cut(mut set: Vec<u32>, rest: &[Vec4]) -> [Vec<u32>; 2] {
    let at = |vertex: u32| rest[vertex as usize].truncate();
    let [low, high] = bounds(set.iter().map(|&vertex| at(vertex)));
    let axis = (high - low).max_position();
    let middle = set.len() / 2;
    set.select_nth_unstable_by(middle, |&a, &b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(&b)));
    let half = set.split_off(middle);
    [set, half]
}

impl<'a> Source<'a> {
    fn new(rest: &'a [Vec4], vertices: usize, links: &'a [Link], colors: &'a [Range<usize>], room: usize) -> Source<'a> {
        let pairs = links.iter().enumerate().flat_map(|(edge, link)| link.ends.map(|end| (end, edge as u32)));
        Source { rest, links, colors, around: Csr::new(vertices, pairs), room }
    }

    /// The tile of these vertices, or tiles of their halves if it would not fit.
    fn fit(&self, own: Vec<u32>, seen: &mut [bool]) -> Option<Vec<Tile>> {
        if let Some(tile) = self.tile(&own, seen) {
            return Some(vec![tile]);
        }
        if own.len() < 2 {
            return None;
        }
        let mut found = Vec::new();
        for mut half in cut(own, self.rest) {
            half.sort_unstable();
            found.extend(self.fit(half, seen)?);
        }
        Some(found)
    }

    /// The tile with everything that its own vertices depend on, if there is room. `seen` is all false before and
    /// after.
    fn tile(&self, own: &[u32], seen: &mut [bool]) -> Option<Tile> {
        let mut vertices = own.to_vec();
        vertices.iter().for_each(|&v| seen[v as usize] = true);
        let mut edges = vec![Vec::new(); self.colors.len()];
        for (color, list) in self.colors.iter().zip(&mut edges).rev() {
            for k in 0..vertices.len() {
                let mut around = self.around.of(vertices[k]).iter();
                let Some(&edge) = around.find(|&&edge| color.contains(&(edge as usize))) else { continue };
                list.push(edge);
                for end in self.links[edge as usize].ends {
                    if !std::mem::replace(&mut seen[end as usize], true) {
                        vertices.push(end);
                    }
                }
            }
            list.sort_unstable();
            list.dedup();
            if vertices.len() > self.room {
                break;
            }
        }
        vertices.iter().for_each(|&v| seen[v as usize] = false);
        vertices[own.len()..].sort_unstable();
        (vertices.len() <= self.room).then_some(Tile { own: own.len(), vertices, edges })
    }
}
