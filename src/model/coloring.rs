//! Edge coloring: batches of edges that share no vertex, visited in one fixed order.
//!
//! The order affects stability, not only speed. One sweep per substep is stable for any fixed coloring, but sweeping
//! rows or tiles one after another is unstable if substeps do not resolve the stiffness. Never reverse or shuffle the
//! order between substeps.

use std::collections::HashMap;

use glam::Vec3;

use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;

/// Colors the edges with `0..colors` such that edges with a common vertex differ. Deterministic.
///
/// Greedy, over edges sorted by direction. On a grid, opposite edges of a vertex are then visited one after the other,
/// so the antisymmetric part of the sweep's matrix vanishes. Each direction gets colors of its own if that needs no
/// more colors than the maximum degree, as on a grid (h0 h1 v0 v1 d0 d1). Otherwise all directions share the colors, in
/// the order, by direction or by vertex, that needs fewer.
pub(crate) fn color(edges: &[[u32; 2]], positions: &[Vec3]) -> Coloring {
    let vertices = positions.len();
    let directions: Vec<u32> = edges.iter().map(|&edge| direction(edge, positions)).collect();
    let by_direction: Csr<u32> = Csr::new(DIRECTIONS, directions.into_iter().zip(0..));
    let fewest = max_degree(edges, vertices);
    if let Some(separate) = greedy(edges, by_direction.lists(), fewest, vertices) {
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

/// Colors the edges so that in the parts of a mesh where some `are_first`, these have lower colors than the others. Other parts are
/// colored as by [`color`].
pub(crate) fn color_in_turn(edges: &[[u32; 2]], positions: &[Vec3], are_first: &[bool]) -> Coloring {
    if !are_first.contains(&true) {
        return color(edges, positions);
    }
    let part = DisjointSets::parts(positions.len(), edges.iter().copied());
    let mut has_turns = vec![false; positions.len()];
    edges.iter().zip(are_first).filter(|(_, is)| **is).for_each(|(ends, _)| has_turns[part[ends[0] as usize] as usize] = true);
    let (turns, others): (Vec<u32>, Vec<u32>) =
        (0..edges.len() as u32).partition(|&edge| has_turns[part[edges[edge as usize][0] as usize] as usize]);
    let of_others: Vec<[u32; 2]> = others.iter().map(|&edge| edges[edge as usize]).collect();
    let Coloring { of: colors_of_others, mut colors } = color(&of_others, positions);
    let [first, later] = [true, false].map(|first| {
        let palette = turns.iter().copied().filter(|&edge| are_first[edge as usize] == first);
        Csr::new(DIRECTIONS, palette.map(|edge| (direction(edges[edge as usize], positions), edge))).items
    });
    let in_turn = greedy(edges, [&first[..], &later[..]].into_iter(), usize::MAX, positions.len()).expect("colors without end");
    let mut of = in_turn.of;
    others.iter().zip(colors_of_others).for_each(|(&edge, color)| of[edge as usize] = color);
    colors = colors.max(in_turn.colors);
    Coloring { of, colors }
}

/// The result of [`color`].
pub(crate) struct Coloring {
    /// The color of each edge.
    pub of: Vec<u32>,
    /// Number of colors.
    pub colors: usize,
}

impl Coloring {
    /// The edges of each color, in their given order.
    pub(crate) fn batches(&self) -> Csr<u32> {
        Csr::new(self.colors, self.of.iter().copied().zip(0..))
    }
}

/// Maximum number of edges at one vertex, a lower bound for the number of colors.
pub(crate) fn max_degree(edges: &[[u32; 2]], vertices: usize) -> usize {
    let mut degree = vec![0; vertices];
    edges.iter().flatten().for_each(|&vertex| degree[vertex as usize] += 1);
    degree.into_iter().max().unwrap_or(0)
}

/// Number of distinct directions: each component is rounded to -4..=4.
const DIRECTIONS: usize = 9 * 9 * 9;

/// The direction of an edge as a number, equal for both orientations and for parallel edges, ascending with the rounded
/// components.
fn direction([a, b]: [u32; 2], positions: &[Vec3]) -> u32 {
    // In double precision, because the square of a long or short edge's length may exceed the range of single
    // precision.
    let [a, b] = [a, b].map(|vertex| positions[vertex as usize].as_dvec3());
    let d = (b - a).normalize_or_zero();
    let rounded = [d.x, d.y, d.z].map(|component| (4.0 * component).round() as i32);
    let [x, y, z] = rounded.max(rounded.map(|component| -component)).map(|component| (component + 4) as u32);
    (x * 9 + y) * 9 + z
}

/// First-fit coloring, in which each palette gets new colors. None if that takes more than `most` colors.
///
/// A row of a grid's edges gets a single color if possible, so that its edges can be processed by contiguous loads.
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
            // So many consecutive edges have no vertex in common.
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

/// Minimum number of edges in a row that gets a common color.
const ROW: usize = 8;

/// The colors of the current palette that each vertex has, as bits in words of 64. One word suffices except for
/// triangle fans with many triangles.
///
/// Further words are stored sparsely, and for each vertex the first word that is not full is remembered. Each vertex on
/// a fan's rim has one color, which may be any of as many as there are vertices, while the hub has them all.
struct Used {
    first: Vec<u64>,
    /// Words from number 1 on, by vertex and number.
    further: HashMap<(u32, u32), u64>,
    /// The number of the first word from 1 on that is not full, if it is not 1.
    open: HashMap<u32, u32>,
}

impl Used {
    fn new(vertices: usize) -> Used {
        Used { first: vec![0; vertices], further: HashMap::new(), open: HashMap::new() }
    }

    /// Removes the colors of the last palette, given the vertices of the next one.
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

    /// The first color that none of the vertices has, if it is among the first 64; rows of a grid need no others.
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

/// The first bit that is 0.
fn first_free(taken: u64) -> Option<usize> {
    (taken != u64::MAX).then(|| taken.trailing_ones() as usize)
}

#[cfg(test)]
#[path = "../../tests/unit/model_coloring.rs"]
mod tests;
