//! The color order cut into pieces for several threads: the same order edge for edge, and a thread waits for its neighbors twice a
//! sweep instead of for all others once a color.
//!
//! The vertices are cut into tiles, ranges of the vertex order, in which neighbors are near. Walk the edges in color
//! order: an edge inside one tile goes to that tile's piece of the first round, unless an edge that had to wait came to
//! one of its ends before. Any other edge waits for the second round, and so do its ends. So within a round no two pieces
//! share a vertex, and at every vertex the edges come in the order of their colors: the result is the same bit for bit
//! however the cloth is cut, and however many threads take the pieces. What waits spreads by an edge a color at most; where
//! tiles are wider than that, what waits at one border has nothing to do with the next, and each is a piece of its own.
//! Where they are not (many colors, as on coarse levels), what waits is cut again half a tile farther on, and again, a round each.
//!
//! A piece stays in cache: all colors of a tile pass before the next tile is touched.

use std::ops::Range;

use crate::model::cloth::Link;
use crate::model::disjoint_sets::DisjointSets;
use crate::simd;

/// Vertices in a tile, at least: fewer are not worth a piece (about 10 us).
const LEAST: usize = 512;
/// Tiles are this many times the mean distance in memory between an edge's ends: eight rows of a grid, and what waits at
/// a border of it is four on each side.
const REACH: f64 = 12.0;
/// Tiles of a coarse level, at most: more are more rounds.
const SHARES: usize = 32;
/// Rounds, at most but one.
const MOST: usize = 16;
/// Parts of a border up to this many vertices together are one piece.
const CRUMBS: usize = 128;
/// As many vertices as a loop over them takes at a time.
const TOGETHER: usize = simd::MAX_LANES;
/// No piece yet.
const NONE: u32 = u32::MAX;

/// See the module. Made once for a cloth.
#[derive(Debug, Clone)]
pub(crate) struct Partition {
    pub tiles: Vec<Range<u32>>,
    /// Each tile, and those that its edges lead to.
    pub around: Vec<Vec<u32>>,
    /// The pieces of each round. Those of the first are the tiles'.
    pub rounds: Vec<Vec<Piece>>,
}

/// Edges that one thread visits in a round, and the vertices that are then done with.
#[derive(Debug, Clone, Default)]
pub(crate) struct Piece {
    /// Places in the color order, ascending.
    pub edges: Vec<u32>,
    pub vertices: Vec<Range<u32>>,
    /// Tiles of all vertices that it visits, and of all that look at those that it moves.
    pub touches: Vec<u32>,
}

/// Adds a tile to a short list, in order.
fn insert(list: &mut Vec<u32>, tile: u32) {
    if let Err(place) = list.binary_search(&tile) {
        list.insert(place, tile);
    }
}

impl Partition {
    /// Cuts `links`, of which the first `swept` are in color order, between `vertices` vertices.
    pub(crate) fn new(links: &[Link], swept: usize, vertices: usize) -> Partition {
        Partition::cut(links, swept, vertices, ((REACH * distance(links)) as usize).max(LEAST))
    }

    /// The same for the many colors of a coarse level, which would make one piece of all borders: narrower tiles, more rounds.
    /// For one thread a single tile: all colors in turn.
    pub(crate) fn coarse(links: &[Link], vertices: usize, threads: usize) -> Partition {
        if threads == 1 {
            return Partition::cut(links, links.len(), vertices, vertices);
        }
        let narrow = (0.5 * REACH * distance(links)) as usize;
        Partition::cut(links, links.len(), vertices, narrow.max(vertices / SHARES).max(LEAST / 4))
    }

    /// The same with tiles of about `length` vertices.
    fn cut(links: &[Link], swept: usize, vertices: usize, length: usize) -> Partition {
        let count = (vertices / length).max(1);
        let start = |tile: usize| match tile {
            _ if tile == count => vertices as u32,
            _ => (tile * vertices / count / TOGETHER * TOGETHER) as u32,
        };
        let ranges: Vec<Range<u32>> = (0..count).map(|tile| start(tile)..start(tile + 1)).collect();
        let mut tile_of = vec![0_u32; vertices];
        for (tile, range) in ranges.iter().enumerate() {
            tile_of[range.start as usize..range.end as usize].fill(tile as u32);
        }
        let crosses = |link: &Link| tile_of[link.ends[0] as usize] != tile_of[link.ends[1] as usize];

        let mut waits = vec![false; vertices];
        // Edges between two pins are not swept, but forces look along them, at places that the first round must not move.
        for link in links[swept..].iter().filter(|link| crosses(link)) {
            link.ends.iter().for_each(|&end| waits[end as usize] = true);
        }
        let places: Vec<u32> = (0..swept as u32).collect();
        let (first, mut late) = round(links, &places, &tile_of, count, &mut waits);
        // Vertices are moved so many at a time: one that waits holds up those beside it, rather than that they are moved one by one.
        for beside in waits.chunks_mut(TOGETHER).filter(|beside| beside.contains(&true)) {
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
            // What waits at one border has met what waits at the next. Cut it where the borders were not.
            let length = vertices.div_ceil(count);
            let shift = if rounds.len() % 2 == 1 { length / 2 } else { 0 };
            let group = |vertex: usize| vertex / TOGETHER * TOGETHER;
            let again: Vec<u32> = (0..vertices).map(|vertex| ((group(vertex) + shift) / length) as u32).collect();
            let (pieces, later) = round(links, &late, &again, count + 1, &mut vec![false; vertices]);
            if rounds.len() == MOST || later.len() == late.len() {
                // Edges longer than half a tile: whatever waits is at hand as it is.
                rounds.push(last);
                break;
            }
            rounds.push(pieces.into_iter().filter(|piece| !piece.edges.is_empty()).collect());
            late = later;
        }
        give_vertices(links, &waits, &tile_of, &mut rounds);
        let mut around: Vec<Vec<u32>> = (0..count as u32).map(|tile| vec![tile]).collect();
        for [a, b] in links.iter().map(|link| link.ends.map(|end| tile_of[end as usize])).filter(|[a, b]| a != b) {
            insert(&mut around[a as usize], b);
            insert(&mut around[b as usize], a);
        }
        Partition { tiles: ranges, around, rounds }
    }
}

/// Mean distance in memory between an edge's ends.
fn distance(links: &[Link]) -> f64 {
    links.iter().map(|link| f64::from(link.ends[0].abs_diff(link.ends[1]))).sum::<f64>() / links.len().max(1) as f64
}

/// The edges at `places` that lie in one tile and come before any that do not, tile by tile, and the others; marks the vertices
/// that wait for those.
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

/// The connected parts of the edges that wait, one piece each, or several small ones of one tile together.
fn borders(links: &[Link], late: &[u32], waits: &[bool], tile_of: &[u32]) -> Vec<Piece> {
    let mut parts = DisjointSets::new(waits.len());
    let mut edges = vec![0_usize; waits.len()];
    late.iter().for_each(|&place| parts.join(links[place as usize].ends));
    // So are vertices that are moved together.
    for first in (0..waits.len()).step_by(TOGETHER).filter(|&first| waits[first]) {
        (first + 1..waits.len().min(first + TOGETHER)).for_each(|vertex| parts.join([first as u32, vertex as u32]));
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
            if pieces.is_empty() || filled.0 != tile || filled.1 + size > CRUMBS {
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

/// Gives each vertex to the piece that visits its last edge, which moves it; those that wait without an edge, to the one that moves
/// the vertices beside. And says what pieces touch.
fn give_vertices(links: &[Link], waits: &[bool], tile_of: &[u32], rounds: &mut [Vec<Piece>]) {
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
    for first in (0..waits.len()).step_by(TOGETHER).filter(|&first| waits[first]) {
        let beside = &mut owner[first..waits.len().min(first + TOGETHER)];
        let latest = beside.iter().flatten().copied().max_by_key(|&(round, piece)| (round, u32::MAX - piece));
        let latest = latest.unwrap_or_else(|| {
            // Nothing is swept here: forces look on from beyond the border.
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
            piece.touches = ends.chain(given.iter().copied()).map(|vertex| tile_of[vertex as usize]).collect();
            piece.touches.sort_unstable();
            piece.touches.dedup();
            piece.touches.shrink_to_fit();
            piece.vertices = runs(given.into_iter());
        }
    }
    // Tiles that look at what a piece moves.
    for link in links {
        for [moved, by] in [link.ends, [link.ends[1], link.ends[0]]] {
            if let Some((round, piece)) = owner[moved as usize].filter(|&(round, _)| round > 0) {
                insert(&mut rounds[round as usize][piece as usize].touches, tile_of[by as usize]);
            }
        }
    }
}

/// Ascending numbers as ranges.
fn runs(numbers: impl Iterator<Item = u32>) -> Vec<Range<u32>> {
    let mut ranges: Vec<Range<u32>> = Vec::new();
    for number in numbers {
        match ranges.last_mut() {
            Some(last) if last.end == number => last.end += 1,
            _ => ranges.push(number..number + 1),
        }
    }
    ranges
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_partition.rs"]
mod tests;
