//! Edge coloring: batches of edges that share no vertex, visited in one fixed order.
//!
//! The order is a property of stability, not only of speed: one sweep a substep is stable for any fixed coloring, while
//! sweeping rows or tiles one after another explodes below the resolved substep. Never reverse or shuffle it between substeps.

use std::collections::HashMap;

use glam::Vec3;

use crate::model::csr::Csr;

/// A color for each edge, `0..colors`, such that edges with a common vertex differ. Deterministic.
///
/// Greedy, over edges sorted by direction: on a grid, opposite edges of a vertex are then visited one after the other,
/// which makes the sweep's antisymmetric part vanish. Directions get palettes of their own when that costs no color
/// beyond the maximum degree, as on a grid (h0 h1 v0 v1 d0 d1); else they share one, in whichever order needs fewest.
pub(crate) fn color(edges: &[[u32; 2]], positions: &[Vec3]) -> Coloring {
    let vertices = positions.len();
    let directions: Vec<u32> = edges.iter().map(|&edge| direction(edge, positions)).collect();
    let by_direction: Csr<u32> = Csr::new(DIRECTIONS, directions.into_iter().zip(0..));
    let palettes = || by_direction.spans.iter().map(|span| &by_direction.items[span.start as usize..span.end as usize]);
    let fewest = max_degree(edges, vertices);
    if let Some(separate) = greedy(edges, palettes(), fewest, vertices) {
        return separate;
    }
    let by_vertex: Vec<u32> = (0..edges.len() as u32).collect();
    let [shared, plain] =
        [&by_direction.items, &by_vertex].map(|order| greedy(edges, std::iter::once(&order[..]), usize::MAX, vertices));
    match (shared, plain) {
        (Some(shared), Some(plain)) if shared.colors <= plain.colors => shared,
        (shared, plain) => plain.or(shared).expect("there are colors without end"),
    }
}

/// The result of [`color`].
#[derive(Debug, Clone)]
pub(crate) struct Coloring {
    /// The color of each edge.
    pub of: Vec<u32>,
    /// Number of colors.
    pub colors: usize,
}

impl Coloring {
    /// The edges of each color, in their order.
    pub(crate) fn batches(&self) -> Csr<u32> {
        Csr::new(self.colors, self.of.iter().copied().zip(0..))
    }
}

/// Most edges at one vertex: no coloring has fewer colors.
pub(crate) fn max_degree(edges: &[[u32; 2]], vertices: usize) -> usize {
    let mut degree = vec![0; vertices];
    edges.iter().flatten().for_each(|&vertex| degree[vertex as usize] += 1);
    degree.into_iter().max().unwrap_or(0)
}

/// Directions that are told apart: a rounded component is -4..=4.
const DIRECTIONS: usize = 9 * 9 * 9;

/// The edge's direction, the same for both ways along it, rounded so that parallel edges agree; numbered in the order of
/// components.
fn direction([a, b]: [u32; 2], positions: &[Vec3]) -> u32 {
    // In double precision, which has the square of any edge's length.
    let [a, b] = [a, b].map(|vertex| positions[vertex as usize].as_dvec3());
    let d = (b - a).normalize_or_zero();
    let rounded = [d.x, d.y, d.z].map(|component| (4.0 * component).round() as i32);
    let [x, y, z] = rounded.max(rounded.map(|component| -component)).map(|component| (component + 4) as u32);
    (x * 9 + y) * 9 + z
}

/// First fit, each palette with colors of its own; none if that takes more than `most`.
///
/// A row of a grid's edges is given one color if it can be, so that they can be visited side by side.
fn greedy<'a>(edges: &[[u32; 2]], palettes: impl Iterator<Item = &'a [u32]>, most: usize, vertices: usize) -> Option<Coloring> {
    let mut used = Used::new(vertices);
    let mut of = vec![0; edges.len()];
    let mut colors = 0;
    for palette in palettes {
        let base = colors;
        used.clear(palette.iter().flat_map(|&index| edges[index as usize]));
        let mut give = |row: &[u32]| {
            let ends = || row.iter().flat_map(|&index| edges[index as usize]);
            let free = if let &[index] = row { Some(used.free(edges[index as usize])) } else { used.free_to_all(ends()) };
            let Some(color) = free.filter(|&color| base + color < most) else { return false };
            ends().for_each(|vertex| used.take(color, vertex));
            row.iter().for_each(|&index| of[index as usize] = (base + color) as u32);
            colors = colors.max(base + color + 1);
            true
        };
        let beside = |&one: &u32, &next: &u32| edges[one as usize].map(|vertex| vertex + 1) == edges[next as usize];
        for run in palette.chunk_by(beside) {
            // So many have no vertex in common.
            let [a, b] = edges[run[0] as usize];
            for row in run.chunks(a.abs_diff(b) as usize) {
                if (row.len() < ROW || !give(row)) && !row.chunks(1).all(&mut give) {
                    return None;
                }
            }
        }
    }
    Some(Coloring { of, colors })
}

/// Edges that are worth a color in common.
const ROW: usize = 8;

/// The colors of a palette that each vertex has: a bit each, in words of 64. One word does for all but the wildest fans.
///
/// Beyond it a vertex has only the words that it has a color in, and says which are full: every vertex of a fan's rim has one color,
/// which may be any of as many as there are vertices, and the hub has them all.
struct Used {
    first: Vec<u64>,
    /// Words from number 1 on, by vertex and number.
    further: HashMap<(u32, u32), u64>,
    /// The first of those that is not full, where it is not number 1.
    open: HashMap<u32, u32>,
}

impl Used {
    fn new(vertices: usize) -> Used {
        Used { first: vec![0; vertices], further: HashMap::new(), open: HashMap::new() }
    }

    /// Forgets the colors of the palette before, given the vertices of the next.
    fn clear(&mut self, vertices: impl Iterator<Item = u32>) {
        vertices.for_each(|vertex| self.first[vertex as usize] = 0);
        self.further.clear();
        self.open.clear();
    }

    /// The first color that neither end has.
    fn free(&self, ends: [u32; 2]) -> usize {
        if let Some(color) = self.free_to_all(ends.into_iter()) {
            return color;
        }
        let open = ends.map(|end| self.open.get(&end).copied().unwrap_or(1));
        (open[0].max(open[1])..)
            .find_map(|number| {
                let [a, b] = ends.map(|end| self.further.get(&(end, number)).copied().unwrap_or(0));
                first_free(a | b).map(|color| 64 * number as usize + color)
            })
            .expect("a word past the last used color is free")
    }

    /// The first color that none of these has, if it is one of the first 64: rows of a grid need no others.
    fn free_to_all(&self, vertices: impl Iterator<Item = u32>) -> Option<usize> {
        first_free(vertices.fold(0, |taken, vertex| taken | self.first[vertex as usize]))
    }

    fn take(&mut self, color: usize, vertex: u32) {
        let (number, bit) = ((color / 64) as u32, 1 << (color % 64));
        if number == 0 {
            self.first[vertex as usize] |= bit;
            return;
        }
        let word = self.further.entry((vertex, number)).or_default();
        *word |= bit;
        if *word == u64::MAX {
            let open = self.open.entry(vertex).or_insert(1);
            while self.further.get(&(vertex, *open)) == Some(&u64::MAX) {
                *open += 1;
            }
        }
    }
}

/// The first bit that is not set.
fn first_free(taken: u64) -> Option<usize> {
    (taken != u64::MAX).then(|| taken.trailing_ones() as usize)
}

#[cfg(test)]
#[path = "../../tests/unit/model_coloring.rs"]
mod tests;
