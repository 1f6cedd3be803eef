//! Domain decomposition of the edge sweep for threads. At each vertex the edges are still visited in color order, and a
//! thread waits for neighboring parts twice a sweep instead of for all threads after each color.
//!
//! The vertices are cut into tiles, contiguous ranges of the vertex order, in which neighbors are close. Walk the edges
//! in color order. An edge inside one tile goes to that tile's piece of the first round, unless one of its vertices
//! already belongs to a deferred edge. Any other edge is deferred to the second round, and marks both its vertices. So
//! within a round no two pieces share a vertex, and at every vertex the edges come in color order: the result is the
//! same bit for bit however the cloth is cut and however many threads process the pieces.
//!
//! Deferral spreads from a border by at most one edge per color. Where tiles are wider than that, the deferred edges of
//! different borders are independent, and each border is a piece of its own. Where they are not (on coarse levels,
//! which have many colors), the deferred edges are cut again by tiles shifted by half a tile, and so on, one round each
//! time.
//!
//! A piece stays in cache: a thread processes all colors of a tile before it goes to the next tile.

use std::ops::Range;

use crate::model::cloth::Cloth;
use crate::model::csr::distinct;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::link::Link;
use crate::simd;

/// Minimum number of vertices in a tile; the piece of a smaller one is less work than its task costs (about 10 us).
const MIN_TILE: usize = 512;
/// Length of a tile as a multiple of the mean index distance between the ends of an edge: about eight rows of a grid,
/// of which the deferred edges at a border take four rows on each side.
const REACH: f64 = 12.0;
/// Maximum number of tiles of a coarse level. More tiles need more rounds.
const MAX_COARSE_TILES: usize = 32;
/// Maximum number of rounds, not counting the last.
const MAX_ROUNDS: usize = 16;
/// Border pieces with up to this many edges in total are merged into one.
const SMALL_PIECE: usize = 128;
/// Loops over vertices process this many at a time, so a piece owns vertices in groups of this size.
const GROUP: usize = simd::MAX_LANES;
/// Marks a connected part that has no piece yet.
const NONE: u32 = u32::MAX;

/// The decomposition of a cloth's or a level's sweep. See the module's documentation.
pub(crate) struct Partition {
    /// Ranges of vertices, ascending.
    pub tiles: Vec<Range<u32>>,
    /// For each tile, itself and the tiles whose vertices forces read there, ascending.
    pub around: Vec<Vec<u32>>,
    /// The pieces of each round. The first round has exactly one for each tile.
    pub rounds: Vec<Vec<Piece>>,
}

/// The edges that one task sweeps in a round, and the vertices that have no edges left after it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Piece {
    /// Indices in the color order, in the order in which they are swept.
    pub edges: Vec<u32>,
    /// The vertices that this piece's task moves.
    pub vertices: Vec<Range<u32>>,
    /// The tiles of all vertices that the piece visits, and of all that read a vertex which it moves.
    pub touches: Vec<u32>,
}

/// The tile with a vertex; `tiles` are ascending ranges.
pub(crate) fn tile_with(tiles: &[Range<u32>], vertex: u32) -> u32 {
    tiles.partition_point(|tile| tile.end <= vertex) as u32
}

/// Inserts a tile into a short sorted list, unless it is there.
fn insert(list: &mut Vec<u32>, tile: u32) {
    if let Err(place) = list.binary_search(&tile) {
        list.insert(place, tile);
    }
}

impl Partition {
    /// Cuts a cloth of `vertices` vertices. The first `swept` of `links` are in color order, the others are not swept. Forces read
    /// vertices across all links, and across the pairs `apart`, which no link joins.
    pub(crate) fn new(links: &[Link], swept: usize, apart: &[[u32; 2]], vertices: usize) -> Partition {
        Partition::cut(links, swept, apart, vertices, ((REACH * distance(links)) as usize).max(MIN_TILE))
    }

    /// The same for a coarse level. Its many colors would connect all borders into one piece, so the tiles are narrower
    /// and there are more rounds. For one thread there is a single tile.
    pub(crate) fn coarse(links: &[Link], vertices: usize, threads: usize) -> Partition {
        if threads == 1 {
            return Partition::cut(links, links.len(), &[], vertices, vertices);
        }
        let narrow = (0.5 * REACH * distance(links)) as usize;
        Partition::cut(links, links.len(), &[], vertices, narrow.max(vertices / MAX_COARSE_TILES).max(MIN_TILE / 4))
    }

    /// The pieces of each round on the way back of a sweep, which visits the rounds from the last to the first, and in
    /// each piece the edges with a second visit in reverse order. Empty if there are none.
    pub(crate) fn rounds_back(&self, cloth: &Cloth) -> Vec<Vec<Piece>> {
        let again = |&edge: &u32| cloth.is_visited_again(edge as usize);
        let back = |Piece { edges, .. }: &Piece| {
            let edges = edges.iter().rev().copied().filter(again).collect();
            Piece { edges, ..Piece::default() }
        };
        let rounds = if cloth.sweeps_back { self.rounds.as_slice() } else { &[] };
        rounds.iter().map(|pieces| pieces.iter().map(back).collect()).collect()
    }

    /// Cuts into tiles of about `length` vertices.
    fn cut(links: &[Link], swept: usize, apart: &[[u32; 2]], vertices: usize, length: usize) -> Partition {
        let count = (vertices / length).max(1);
        let start = |tile: usize| match tile {
            _ if tile == count => vertices as u32,
            // With 64 bits where addresses have 32, too.
            _ => (tile as u64 * vertices as u64 / count as u64) as u32 / GROUP as u32 * GROUP as u32,
        };
        let ranges: Vec<Range<u32>> = (0..count).map(|tile| start(tile)..start(tile + 1)).collect();
        let mut tile_of = vec![0_u32; vertices];
        for (tile, range) in ranges.iter().enumerate() {
            tile_of[range.start as usize..range.end as usize].fill(tile as u32);
        }
        let mut waits = vec![false; vertices];
        // Edges between two pins are not swept, and some pairs have no edge. But forces read vertices across them, so the first round
        // must not move their vertices.
        let unswept = links[swept..].iter().map(|link| link.ends).chain(apart.iter().copied());
        for ends in unswept.filter(|ends| tile_of[ends[0] as usize] != tile_of[ends[1] as usize]) {
            ends.iter().for_each(|&end| waits[end as usize] = true);
        }
        let places: Vec<u32> = (0..swept as u32).collect();
        let (first, mut late) = round(links, &places, &tile_of, count, &mut waits);
        // Vertices are moved in groups, so a deferred vertex defers its whole group; otherwise they would have to be
        // moved one by one.
        for beside in waits.chunks_mut(GROUP).filter(|beside| beside.contains(&true)) {
            beside.fill(true);
        }
        let most = first.iter().map(|piece| piece.edges.len()).max().unwrap_or(0);
        let mut rounds = vec![first];
        loop {
            let last = borders(links, &late, &waits, &tile_of);
            if last.iter().all(|piece| 2 * piece.edges.len() <= 3 * most) {
                rounds.push(last);
                break;
            }
            // Deferred edges of neighboring borders have merged into large pieces. Cut them again, where the tiles'
            // borders were not.
            let length = vertices.div_ceil(count);
            let shift = if rounds.len() % 2 == 1 { length / 2 } else { 0 };
            let group = |vertex: usize| vertex / GROUP * GROUP;
            let again: Vec<u32> = (0..vertices).map(|vertex| ((group(vertex) + shift) / length) as u32).collect();
            let (pieces, later) = round(links, &late, &again, count + 1, &mut vec![false; vertices]);
            if rounds.len() == MAX_ROUNDS || later.len() == late.len() {
                // Edges are longer than half a tile, so cutting again does not help: accept the large pieces.
                rounds.push(last);
                break;
            }
            rounds.push(pieces.into_iter().filter(|piece| !piece.edges.is_empty()).collect());
            late = later;
        }
        let read = || links.iter().map(|link| link.ends).chain(apart.iter().copied());
        give_vertices(links, read(), &waits, &tile_of, &mut rounds);
        let mut around: Vec<Vec<u32>> = (0..count as u32).map(|tile| vec![tile]).collect();
        for [a, b] in read().map(|ends| ends.map(|end| tile_of[end as usize])).filter(|[a, b]| a != b) {
            insert(&mut around[a as usize], b);
            insert(&mut around[b as usize], a);
        }
        Partition { tiles: ranges, around, rounds }
    }
}

/// Mean index distance between the ends of an edge.
fn distance(links: &[Link]) -> f64 {
    links.iter().map(|link| f64::from(link.ends[0].abs_diff(link.ends[1]))).sum::<f64>() / links.len().max(1) as f64
}

/// Sorts the edges `places` into one piece per tile. Edges between tiles, and edges that come after one at either
/// vertex, are deferred and returned in second place. Marks the vertices of deferred edges in `waits`.
fn round(links: &[Link], places: &[u32], tile_of: &[u32], tiles: usize, waits: &mut [bool]) -> (Vec<Piece>, Vec<u32>) {
    let mut pieces = vec![Piece::default(); tiles];
    let mut late = Vec::new();
    for &place in places {
        let [a, b] = links[place as usize].ends.map(|end| end as usize);
        if tile_of[a] != tile_of[b] || waits[a] || waits[b] {
            (waits[a], waits[b]) = (true, true);
            late.push(place);
        } else {
            pieces[tile_of[a] as usize].edges.push(place);
        }
    }
    (pieces, late)
}

/// Makes pieces of the deferred edges: one for each connected part, except that small parts in one tile are merged.
fn borders(links: &[Link], late: &[u32], waits: &[bool], tile_of: &[u32]) -> Vec<Piece> {
    let mut parts = DisjointSets::new(waits.len());
    let mut edges = vec![0_usize; waits.len()];
    late.iter().for_each(|&place| parts.join(links[place as usize].ends));
    // Vertices of one group are moved together, so they count as connected.
    for first in (0..waits.len()).step_by(GROUP).filter(|&first| waits[first]) {
        (first + 1..waits.len().min(first + GROUP)).for_each(|vertex| parts.join([first as u32, vertex as u32]));
    }
    late.iter().for_each(|&place| edges[parts.root(links[place as usize].ends[0]) as usize] += 1);
    let mut pieces: Vec<Piece> = Vec::new();
    let mut piece_of = vec![NONE; waits.len()];
    let mut filled = (NONE, 0);
    for &place in late {
        let root = parts.root(links[place as usize].ends[0]);
        let piece = &mut piece_of[root as usize];
        if *piece == NONE {
            let (tile, size) = (tile_of[root as usize], edges[root as usize]);
            if pieces.is_empty() || filled.0 != tile || filled.1 + size > SMALL_PIECE {
                pieces.push(Piece::default());
                filled = (tile, 0);
            }
            filled.1 += size;
            *piece = pieces.len() as u32 - 1;
        }
        pieces[*piece as usize].edges.push(place);
    }
    pieces
}

/// Gives each vertex to the piece that sweeps its last edge; that piece's task moves it. Deferred vertices without a
/// deferred edge go to the piece of their group. Then determines which tiles each piece accesses, given the pairs of vertices across
/// which forces `read`.
fn give_vertices(
    links: &[Link],
    read: impl Iterator<Item = [u32; 2]>,
    waits: &[bool],
    tile_of: &[u32],
    rounds: &mut [Vec<Piece>],
) {
    let mut owner: Vec<Option<(u32, u32)>> = vec![None; waits.len()];
    for (round, pieces) in rounds.iter().enumerate().skip(1) {
        for (index, piece) in pieces.iter().enumerate() {
            let ends = piece.edges.iter().flat_map(|&place| links[place as usize].ends);
            ends.for_each(|end| owner[end as usize] = Some((round as u32, index as u32)));
        }
    }
    for (vertex, owner) in owner.iter_mut().enumerate().filter(|&(vertex, _)| !waits[vertex]) {
        *owner = Some((0, tile_of[vertex]));
    }
    let last = rounds.len() as u32 - 1;
    for first in (0..waits.len()).step_by(GROUP).filter(|&first| waits[first]) {
        let beside = &mut owner[first..waits.len().min(first + GROUP)];
        let latest = beside.iter().flatten().copied().max_by_key(|&(round, piece)| (round, u32::MAX - piece));
        let latest = latest.unwrap_or_else(|| {
            // The group has no deferred edge; only forces read it across a border. It gets a piece without edges in the
            // last round.
            rounds[last as usize].push(Piece::default());
            (last, rounds[last as usize].len() as u32 - 1)
        });
        beside.iter_mut().filter(|owner| owner.is_none_or(|(round, _)| round < latest.0)).for_each(|owner| *owner = Some(latest));
    }
    let mut given: Vec<Vec<Vec<u32>>> = rounds.iter().map(|pieces| vec![Vec::new(); pieces.len()]).collect();
    for (vertex, owner) in owner.iter().enumerate() {
        let (round, piece) = owner.unwrap_or((0, tile_of[vertex]));
        given[round as usize][piece as usize].push(vertex as u32);
    }
    for (pieces, given) in rounds.iter_mut().zip(given) {
        for (piece, given) in pieces.iter_mut().zip(given) {
            let ends = piece.edges.iter().flat_map(|&place| links[place as usize].ends);
            piece.touches = distinct(ends.chain(given.iter().copied()).map(|vertex| tile_of[vertex as usize]).collect());
            piece.touches.shrink_to_fit();
            piece.vertices = given.chunk_by(|a, b| a + 1 == *b).map(|run| run[0]..run[run.len() - 1] + 1).collect();
        }
    }
    // Add the tiles whose forces read vertices that the piece moves.
    for ends in read {
        for [moved, by] in [ends, [ends[1], ends[0]]] {
            if let Some((round, piece)) = owner[moved as usize].filter(|&(round, _)| round > 0) {
                insert(&mut rounds[round as usize][piece as usize].touches, tile_of[by as usize]);
            }
        }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_partition.rs"]
mod tests;
