//! Aggregation: divides the vertices of a mesh into connected, balanced, nested groups.

use glam::{DVec3, Vec3};

use crate::model::cloth::Cloth;
use crate::model::csr::{Csr, distinct};
use crate::model::disjoint_sets::DisjointSets;
use crate::model::link::Link;
use crate::model::mesh::bounds;

/// The mass properties of an aggregate at rest. A vertex counts as an aggregate of one.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Aggregate {
    /// Mass (kg).
    pub mass: f64,
    /// Center of mass (m).
    pub center: DVec3,
    pub pinned: bool,
    /// Sum of the normals weighted by twice the area (m²), and of their lengths.
    pub normal: DVec3,
    pub area: f64,
}

/// If the area-weighted normals of an aggregate cancel, up to this share, it goes around a tube.
const CURLED: f64 = 0.1;
/// If they do so up to this share, it is no arc, but folded, or goes around more than half of a tube.
const ARC: f64 = 0.7;

impl Aggregate {
    /// One over the mass (1/kg); 0 if pinned.
    pub(crate) fn inverse_mass(&self) -> f64 {
        if self.pinned { 0.0 } else { 1.0 / self.mass }
    }

    /// A vector along its normal; zero if it has none because it is a thread, or goes around a tube.
    pub(crate) fn normal(&self) -> DVec3 {
        if self.normal.length() < CURLED * self.area { DVec3::ZERO } else { self.normal }
    }

    /// How far (m) its center is from its surface, if it is an arc, as long and wide as the root of its area; otherwise 0. The mean cosine
    /// of an arc's normals to their sum is `sin(a)/a` for half its angle a, and its center is `r - r sin(a)/a` from it.
    pub(crate) fn sagitta(&self) -> f64 {
        if self.normal.length() < ARC * self.area || self.area == 0.0 {
            return 0.0;
        }
        let half_angle = (6.0 * (1.0 - self.normal.length() / self.area)).max(0.0).sqrt();
        (0.5 * self.area).sqrt() * half_angle / 12.0
    }
}

/// The mean size of the finest aggregates is at most this, and at least half of it. Disconnected pieces may be smaller.
/// It is slightly above 16, so that blocks of 4 x 4 vertices of a grid are not halved again, even if some have an extra
/// row.
const FINEST: f64 = 17.5;

/// An aggregate with more neighbors than this is the hub of a fan. Two-ring links through it would join every two aggregates of the rim,
/// while a dozen directions are enough.
pub(crate) const CROWDED: usize = 64;

/// A part with so many holes at most is no net: a garment has some for arms, head and buttons.
const FEW_HOLES: i64 = 8;

/// Recursive bisection of the mesh's connected parts across their longest side.
///
/// On a grid of rows and columns the halves are blocks. Within a part, the two halves of a cut differ in size by at
/// most a row or column.
pub(crate) struct Bisection {
    /// The connected part of each vertex, named by one of its vertices.
    part: Vec<u32>,
    /// The number of holes of each part, at the vertex that names it: 0 of a disk, 1 of a tube, -1 of a closed shell.
    holes: Vec<i64>,
    /// The halves that each vertex falls into, one bit per cut, with the last cut in the lowest bit. The number of cuts
    /// depends on the size of the vertex's part.
    path: Vec<u32>,
}

/// The edges with stiffness. An edge scaled to 0 is a gap.
pub(crate) fn holding(cloth: &Cloth) -> impl Iterator<Item = &Link> {
    cloth.links.iter().filter(|link| link.shape > 0.0)
}

impl Bisection {
    pub(crate) fn new(cloth: &Cloth) -> Bisection {
        let vertices = cloth.rest.len();
        let part = DisjointSets::parts(vertices, holding(cloth).map(|link| link.ends));
        let mut by_part = Csr::new(vertices, part.iter().copied().zip(0..)).items;
        let rest: Vec<Vec3> = cloth.rest.iter().map(|x| x.truncate()).collect();
        let mut path = vec![0; vertices];
        for group in by_part.chunk_by_mut(|&a, &b| part[a as usize] == part[b as usize]) {
            let depth = (group.len() as f64 / FINEST).log2().ceil().max(0.0) as u32;
            bisect(group, depth, 0, &rest, &mut path);
        }
        let holes = holes(cloth, &part);
        Bisection { part, holes, path }
    }

    /// Tells for each of `count` aggregates whether it belongs to a net: a part that has more holes than aggregates.
    ///
    /// The mesh of a net gives way to shear without stretching its strands. Aggregates that span it do not see the holes, and would hold
    /// it as if it were a sheet: one of 15 x 15 meshes, hung by its corners, would gain 1.2 J when it begins to use levels.
    pub(crate) fn of_nets(&self, aggregate_of: &[u32], count: usize) -> Vec<bool> {
        let (mut part_of, mut counts) = (vec![0; count], vec![0; self.part.len()]);
        aggregate_of.iter().zip(&self.part).for_each(|(&aggregate, &part)| part_of[aggregate as usize] = part);
        part_of.iter().for_each(|&part| counts[part as usize] += 1);
        part_of.iter().map(|&part| self.holes[part as usize] > counts[part as usize].max(FEW_HOLES)).collect()
    }

    /// The aggregates of level `level` (0 is the finest, each next level has aggregates four times as large): the
    /// aggregate of each vertex, and their number.
    ///
    /// A cell of the bisection is split into the components connected by edges within it, and pinned vertices are
    /// separated from free ones. Aggregates are numbered in the order of their first vertices, so that neighbors are
    /// close in memory.
    pub(crate) fn of_level(&self, cloth: &Cloth, level: u32) -> (Vec<u32>, usize) {
        let vertices = self.path.len();
        let cell = |vertex: u32| [self.part[vertex as usize], self.path[vertex as usize] >> (2 * level).min(31)];
        let is_free = |vertex: u32| cloth.rest[vertex as usize].w > 0.0;
        let mut sets = DisjointSets::new(vertices);
        for link in holding(cloth) {
            let [a, b] = link.ends;
            if is_free(a) && is_free(b) && cell(a) == cell(b) {
                sets.join([a, b]);
            }
        }
        let pinned = cloth.pinned.iter().map(|&vertex| {
            let [part, path] = cell(vertex);
            [part, path, vertex]
        });
        for pair in distinct(pinned.collect()).windows(2).filter(|pair| pair[0][..2] == pair[1][..2]) {
            sets.join([pair[0][2], pair[1][2]]);
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

/// The neighbors of each of `count` aggregates, in ascending order as the pairs are.
pub(crate) fn neighbors(count: usize, pairs: &[[u32; 2]]) -> Csr<u32> {
    Csr::new(count, pairs.iter().flat_map(|&[a, b]| [(a, b), (b, a)]))
}

/// The number of holes of each connected part, by Euler's formula `1 - V + E - F`.
fn holes(cloth: &Cloth, part: &[u32]) -> Vec<i64> {
    let mut holes: Vec<i64> = (0..).zip(part).map(|(vertex, &part)| i64::from(vertex == part)).collect();
    part.iter().for_each(|&part| holes[part as usize] -= 1);
    holding(cloth).for_each(|link| holes[part[link.ends[0] as usize] as usize] += 1);
    cloth.triangles.iter().for_each(|triangle| holes[part[triangle[0] as usize] as usize] -= 1);
    holes
}

/// Halves a group `depth` times and records in `path` the halves that each vertex falls into.
fn bisect(group: &mut [u32], depth: u32, way: u32, rest: &[Vec3], path: &mut [u32]) {
    if depth == 0 || group.len() < 2 {
        group.iter().for_each(|&vertex| path[vertex as usize] = way << depth);
        return;
    }
    let (low, high) = cut(group, rest);
    bisect(low, depth - 1, 2 * way, rest, path);
    bisect(high, depth - 1, 2 * way + 1, rest, path);
}

/// Cuts a group in two across the longest side of its bounding box, between two grid rows if possible.
fn cut<'a>(group: &'a mut [u32], rest: &[Vec3]) -> (&'a mut [u32], &'a mut [u32]) {
    let at = |vertex: &u32| rest[*vertex as usize];
    let [low, high] = bounds(group.iter().map(at));
    let size = high - low;
    // Within rounding errors, equal sides count as equal and x is preferred.
    let longest = size.max_element();
    let axis = (0..3).find(|&axis| size[axis] >= 0.9999 * longest).unwrap_or(0);
    let along = |vertex: &u32| at(vertex)[axis];
    let order = |a: &u32, b: &u32| along(a).total_cmp(&along(b)).then(a.cmp(b));
    let half = group.len() / 2;
    let middle = along(group.select_nth_unstable_by(half, order).1);
    let before = group.iter().filter(|&vertex| along(vertex) < middle - 1e-4 * longest).count();
    let through = group.iter().filter(|&vertex| along(vertex) <= middle + 1e-4 * longest).count();
    let nearest = if half - before <= through - half { before } else { through };
    // In a group of few rows, no boundary between rows may be close to the middle.
    let count = if 4 * nearest.min(group.len() - nearest) >= group.len() { nearest } else { half };
    group.select_nth_unstable_by(count, order);
    group.split_at_mut(count)
}
