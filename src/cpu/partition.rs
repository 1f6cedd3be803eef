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
mod tests {
    use super::*;
    use crate::model::cloth::Cloth;
    use crate::multigrid::hierarchy::Hierarchy;
    use crate::{Mesh, Options};

    fn cloths() -> Vec<(&'static str, Cloth)> {
        let build = |mesh: &Mesh, pinned| Cloth::new(mesh, &Options { pinned, ..Options::default() }).unwrap();
        let grid = Mesh::grid(40, 60, 1.0, 1.5);
        let mut shuffled = grid.clone();
        let mut names: Vec<u32> = (0..2400).collect();
        fastrand::Rng::with_seed(5).shuffle(&mut names);
        names.iter().zip(&grid.positions).for_each(|(&name, &x)| shuffled.positions[name as usize] = x);
        shuffled.triangles.iter_mut().flatten().for_each(|vertex| *vertex = names[*vertex as usize]);
        let mut fan = Mesh::grid(30, 30, 1.0, 1.0);
        fan.triangles.extend((1..899).map(|k| [0, k, k + 1]));
        let mut two = grid.clone();
        two.positions.extend(grid.positions.iter().map(|x| *x + glam::Vec3::Y));
        two.triangles.extend(grid.triangles.iter().map(|t| t.map(|v| v + 2400)));
        // Vertices without an edge.
        let mut loose = grid.clone();
        loose.triangles.retain(|corners| !corners.iter().any(|vertex| vertex % 50 > 45));
        vec![
            ("grid", build(&grid, vec![0, 39])),
            ("loose", build(&loose, vec![0, 39])),
            ("pinned rows", build(&grid, (0..1300).collect())),
            ("shuffled", build(&shuffled, vec![])),
            ("fan", build(&fan, vec![])),
            ("two", build(&two, vec![7])),
            ("one triangle", build(&Mesh { triangles: vec![[0, 1, 2]], ..Mesh::grid(2, 2, 1.0, 1.0) }, vec![])),
        ]
    }

    /// Every edge and every vertex once; no piece writes where another of its round writes or, outside, reads what it moves;
    /// and at every vertex the edges come in the order of their colors.
    #[test]
    fn tiles_keep_the_color_order() {
        for (name, cloth) in cloths() {
            for length in [1, 7, 100, 330, 5000] {
                let swept = cloth.swept();
                let partition = Partition::cut(&cloth.links, swept.len(), cloth.rest.len(), length);
                let mut owner = vec![(0, 0); cloth.rest.len()];
                let mut moved = vec![0; cloth.rest.len()];
                for (round, pieces) in partition.rounds.iter().enumerate() {
                    for (index, piece) in pieces.iter().enumerate() {
                        for vertex in piece.vertices.iter().cloned().flatten() {
                            moved[vertex as usize] += 1;
                            owner[vertex as usize] = (round, index);
                        }
                    }
                }
                let mut visited = vec![0; swept.len()];
                let mut latest = vec![None; cloth.rest.len()];
                for (round, pieces) in partition.rounds.iter().enumerate() {
                    let mut visitor = vec![None; cloth.rest.len()];
                    for (index, piece) in pieces.iter().enumerate() {
                        for &place in &piece.edges {
                            visited[place as usize] += 1;
                            for end in swept[place as usize].ends.map(|end| end as usize) {
                                assert!(visitor[end].is_none_or(|by| by == index), "{name} {length}: two pieces of a round meet");
                                visitor[end] = Some(index);
                                assert!(latest[end] < Some(place), "{name} {length}: {end} sees {place} after {:?}", latest[end]);
                                latest[end] = Some(place);
                                if round == 0 {
                                    assert!(partition.tiles[index].contains(&(end as u32)), "{name} {length}: not its tile");
                                }
                                let by = owner[end];
                                assert!(by.0 > round || by == (round, index), "{name} {length}: moved before its last edge");
                            }
                        }
                    }
                }
                assert!(visited.iter().all(|&count| count == 1) && moved.iter().all(|&count| count == 1), "{name} {length}");
                let of = |vertex: u32| partition.tiles.iter().position(|range| range.contains(&vertex));
                // A piece waits for all who meet it.
                for (round, pieces) in partition.rounds.iter().enumerate() {
                    for (index, piece) in pieces.iter().enumerate() {
                        let touches = |vertex: u32| piece.touches.binary_search(&(of(vertex).unwrap() as u32)).is_ok();
                        let ends = piece.edges.iter().flat_map(|&place| swept[place as usize].ends);
                        assert!(ends.chain(piece.vertices.iter().cloned().flatten()).all(touches), "{name} {length}");
                        let moves = |end: u32| owner[end as usize] == (round, index);
                        let looks = cloth.links.iter().map(|link| link.ends).filter(|ends| ends.iter().any(|&end| moves(end)));
                        assert!(looks.flatten().all(touches), "{name} {length}: somebody looks at what {round}.{index} moves");
                    }
                }
                for [a, b] in cloth.links.iter().map(|link| link.ends) {
                    let [a, b] = [a, b].map(|end| of(end).unwrap());
                    assert!(
                        partition.around[a].contains(&(b as u32)) && partition.around[b].contains(&(a as u32)),
                        "{name} {length}"
                    );
                }
                // What lies across from a tile's border is not moved in the first round: forces look there.
                for link in &cloth.links {
                    let [a, b] = link.ends;
                    assert!(of(a) == of(b) || [a, b].iter().all(|&end| owner[end as usize].0 > 0), "{name} {length}");
                }
            }
        }
    }

    #[test]
    fn borders_of_a_grid_are_apart() {
        let cloth = Cloth::new(&Mesh::grid(64, 128, 1.0, 2.0), &Options::default()).unwrap();
        let partition = Partition::new(&cloth.links, cloth.swept().len(), cloth.rest.len());
        assert!(partition.tiles.len() > 8, "{} tiles", partition.tiles.len());
        assert_eq!(partition.rounds.len(), 2);
        assert_eq!(partition.rounds[1].len(), partition.tiles.len() - 1);
        let late: usize = partition.rounds[1].iter().map(|piece| piece.edges.len()).sum();
        assert!(late < cloth.swept().len() / 2, "{late} of {} edges wait", cloth.swept().len());
    }

    /// Where colors are many for the tiles' width, more rounds keep the pieces small.
    #[test]
    fn coarse_levels_share_their_work() {
        let cloth = Cloth::new(&Mesh::grid(256, 256, 1.0, 1.0), &Options::default()).unwrap();
        let level = &Hierarchy::new(&cloth).levels[0];
        let partition = Partition::coarse(&level.links, level.inverse_mass.len(), 16);
        let edges = |piece: &Piece| piece.edges.len();
        let longest: usize = partition.rounds.iter().filter_map(|pieces| pieces.iter().map(edges).max()).sum();
        let most: Vec<(usize, usize)> =
            partition.rounds.iter().map(|pieces| (pieces.len(), pieces.iter().map(edges).max().unwrap_or(0))).collect();
        println!("{} edges, {} colors: {most:?}", level.links.len(), level.colors.len());
        assert!(5 * longest < level.links.len(), "one after another {longest} of {} edges: {most:?}", level.links.len());
    }
}
