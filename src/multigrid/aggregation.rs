//! Aggregates: the vertices of a mesh in connected, balanced, nested groups.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::model::cloth::{Cloth, Link};
use crate::model::disjoint_sets::DisjointSets;

/// An aggregate at rest; a vertex is one by itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Aggregate {
    /// Mass (kg), and its center (m).
    pub mass: f64,
    pub center: DVec3,
    pub pinned: bool,
    /// Sum of the normals, each as long as the area it stands for.
    pub normal: DVec3,
}

impl Aggregate {
    /// One over the mass (1/kg), 0 where pinned.
    pub(crate) fn inverse_mass(&self) -> f64 {
        if self.pinned { 0.0 } else { 1.0 / self.mass }
    }
}

/// Most vertices of the finest aggregates, half as many the fewest, but for pieces cut off. A grid's 4 x 4 blocks fit, and a row more
/// here and there.
const FINEST: f64 = 17.5;

/// The mesh's parts by recursive bisection across their longest side: which half of which half each vertex is in.
///
/// On a grid of rows and columns the halves are blocks. Sizes within a part differ by a row or column at each cut.
#[derive(Debug)]
pub(crate) struct Bisection {
    /// The part of each vertex, named by one of its vertices.
    part: Vec<u32>,
    /// Its halves, one bit each, the last one lowest; as many as `depth` of its part says.
    path: Vec<u32>,
}

/// The edges that hold: one scaled to nothing is a gap.
pub(crate) fn holding(cloth: &Cloth) -> impl Iterator<Item = &Link> {
    cloth.links.iter().filter(|link| link.shape > 0.0)
}

impl Bisection {
    pub(crate) fn new(cloth: &Cloth) -> Bisection {
        let vertices = cloth.rest.len();
        let mut parts = DisjointSets::new(vertices);
        holding(cloth).for_each(|link| parts.join(link.ends));
        let part: Vec<u32> = (0..vertices as u32).map(|vertex| parts.root(vertex)).collect();
        let mut by_part: Vec<u32> = (0..vertices as u32).collect();
        by_part.sort_by_key(|&vertex| part[vertex as usize]);
        let rest: Vec<Vec3> = cloth.rest.iter().map(|x| x.truncate()).collect();
        let mut path = vec![0; vertices];
        for group in by_part.chunk_by_mut(|&a, &b| part[a as usize] == part[b as usize]) {
            let depth = (group.len() as f64 / FINEST).log2().ceil().max(0.0) as u32;
            bisect(group, depth, 0, &rest, &mut path);
        }
        Bisection { part, path }
    }

    /// The aggregates of level `level` (0 the finest, each next one four times as large): that of each vertex, and how many.
    ///
    /// Vertices of the same cell that no edges of the cell connect are apart, and so are the pinned ones from the free.
    /// Aggregates are numbered in the order of their first vertices, so that neighbors are near in memory.
    pub(crate) fn of_level(&self, cloth: &Cloth, level: u32) -> (Vec<u32>, usize) {
        let vertices = self.path.len();
        let cell = |vertex: u32| (self.part[vertex as usize], self.path[vertex as usize] >> (2 * level).min(31));
        let is_free = |vertex: u32| cloth.rest[vertex as usize].w > 0.0;
        let mut sets = DisjointSets::new(vertices);
        for link in holding(cloth) {
            let [a, b] = link.ends;
            if is_free(a) && is_free(b) && cell(a) == cell(b) {
                sets.join([a, b]);
            }
        }
        let mut pinned: HashMap<(u32, u32), u32> = HashMap::new();
        for &vertex in &cloth.pinned {
            sets.join([*pinned.entry(cell(vertex)).or_insert(vertex), vertex]);
        }
        let mut number = vec![u32::MAX; vertices];
        let mut count = 0;
        let numbered = (0..vertices as u32).map(|vertex| {
            let name = &mut number[sets.root(vertex) as usize];
            if *name == u32::MAX {
                (*name, count) = (count, count + 1);
            }
            *name
        });
        (numbered.collect(), count as usize)
    }
}

/// Halves a group `depth` times; `path` takes down the way to each vertex.
fn bisect(group: &mut [u32], depth: u32, way: u32, rest: &[Vec3], path: &mut [u32]) {
    if depth == 0 || group.len() < 2 {
        group.iter().for_each(|&vertex| path[vertex as usize] = way << depth);
        return;
    }
    let (low, high) = cut(group, rest);
    bisect(low, depth - 1, 2 * way, rest, path);
    bisect(high, depth - 1, 2 * way + 1, rest, path);
}

/// Cuts a group in two across the longest side of its box, between two rows if it has any.
fn cut<'a>(group: &'a mut [u32], rest: &[Vec3]) -> (&'a mut [u32], &'a mut [u32]) {
    let at = |vertex: &u32| rest[*vertex as usize];
    let low = group.iter().map(at).fold(Vec3::INFINITY, Vec3::min);
    let size = group.iter().map(at).fold(Vec3::NEG_INFINITY, Vec3::max) - low;
    // A square counts as long in x, whatever its roundings.
    let longest = size.max_element();
    let axis = (0..3).find(|&axis| size[axis] >= 0.9999 * longest).unwrap_or(0);
    let along = |vertex: &u32| at(vertex)[axis];
    let order = |a: &u32, b: &u32| along(a).total_cmp(&along(b)).then(a.cmp(b));
    let half = group.len() / 2;
    let middle = along(group.select_nth_unstable_by(half, order).1);
    let before = group.iter().filter(|&vertex| along(vertex) < middle - 1e-4 * longest).count();
    let through = group.iter().filter(|&vertex| along(vertex) <= middle + 1e-4 * longest).count();
    let nearest = if half - before <= through - half { before } else { through };
    // A group of few rows may have none that ends near its middle.
    let count = if 4 * nearest.min(group.len() - nearest) >= group.len() { nearest } else { half };
    group.select_nth_unstable_by(count, order);
    group.split_at_mut(count)
}
