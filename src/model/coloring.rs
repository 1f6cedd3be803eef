//! Edge coloring: batches of edges that share no vertex, visited in one fixed order.
//!
//! The order is a property of stability, not only of speed: one sweep a substep is stable for any fixed coloring, while
//! sweeping rows or tiles one after another explodes below the resolved substep. Never reverse or shuffle it between substeps.

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
    let d = (positions[b as usize] - positions[a as usize]).normalize_or_zero();
    let rounded = [d.x, d.y, d.z].map(|component| (4.0 * component).round() as i32);
    let [x, y, z] = rounded.max(rounded.map(|component| -component)).map(|component| (component + 4) as u32);
    (x * 9 + y) * 9 + z
}

/// First fit, each palette with colors of its own; none if that takes more than `most`.
///
/// A row of a grid's edges is given one color if it can be, so that they can be visited side by side.
fn greedy<'a>(edges: &[[u32; 2]], palettes: impl Iterator<Item = &'a [u32]>, most: usize, vertices: usize) -> Option<Coloring> {
    let mut used = Used { first: vec![0; vertices], further: Vec::new() };
    let mut of = vec![0; edges.len()];
    let mut colors = 0;
    for palette in palettes {
        let base = colors;
        let mut give = |row: &[u32]| {
            let ends = || row.iter().flat_map(|&index| edges[index as usize]);
            let color = used.free(base, ends);
            if color >= most {
                return false;
            }
            ends().for_each(|vertex| used.take(color, vertex));
            row.iter().for_each(|&index| of[index as usize] = color as u32);
            colors = colors.max(color + 1);
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

/// A bit for each color that a vertex has already; one word does for all but the wildest fans.
struct Used {
    first: Vec<u64>,
    further: Vec<Vec<u64>>,
}

impl Used {
    /// The first color from `base` on that none of these vertices has.
    fn free<I: Iterator<Item = u32>>(&self, base: usize, vertices: impl Fn() -> I) -> usize {
        (base / 64..)
            .find_map(|word| {
                let below = if word == base / 64 { (1 << (base % 64)) - 1 } else { 0 };
                let free = !vertices().fold(below, |taken, vertex| taken | self.word(vertex as usize, word));
                (free != 0).then(|| 64 * word + free.trailing_zeros() as usize)
            })
            .expect("a word past the last used color is free")
    }

    fn word(&self, vertex: usize, word: usize) -> u64 {
        match word {
            0 => self.first[vertex],
            _ => self.further.get(vertex).and_then(|words| words.get(word - 1)).copied().unwrap_or(0),
        }
    }

    fn take(&mut self, color: usize, vertex: u32) {
        let vertex = vertex as usize;
        if color < 64 {
            self.first[vertex] |= 1 << color;
            return;
        }
        self.further.resize_with(self.first.len(), Vec::new);
        let words = &mut self.further[vertex];
        words.resize(words.len().max(color / 64), 0);
        words[color / 64 - 1] |= 1 << (color % 64);
    }
}

#[cfg(test)]
#[path = "../../tests/unit/model_coloring.rs"]
mod tests;
