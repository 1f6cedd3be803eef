//! Detection lists the pairs of features that may come closer than their thickness within some substeps.
//!
//! Features are compared at the midpoints of their straight predicted paths over these substeps. A pair is not listed
//! if its distance there exceeds the sum of its thickness, the distances that both may stray from their paths
//! ([`Path::stray`]), and half of their relative motion. When a vertex strays farther than assumed, everything is
//! detected again. Lists are as long as necessary: no pair is dropped.

use std::ops::Range;

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::boxes::Boxes;
use super::lanes::{corners_of, fourth_of, scattered};
use super::surface::Surface;
use super::tree::{Look, Tree};
use super::{Path, for_chunks};
use crate::kernels::pair::{edge_edge, vertex_triangle};
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector, Width};

/// Pairs of leaves per task.
const GRAIN: usize = 32;
/// Vertices per task when computing midpoints.
const GROUP: usize = 4096;

/// Limit on the number of pairs of leaves: this many, plus this many per leaf. A heap has tens per leaf; a cloth in a
/// single point has all pairs.
const CROWD: [usize; 2] = [100_000, 512];

/// Indices of the features' boxes.
const TRIANGLES: usize = 0;
const EDGES: usize = 1;
const VERTICES: usize = 2;

/// The kinds of pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    VertexTriangle,
    EdgeEdge,
}

impl Kind {
    pub(super) const ALL: [Kind; 2] = [Kind::VertexTriangle, Kind::EdgeEdge];
}

/// A listed pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Listed {
    pub corners: [u32; 4],
    /// The second feature; the first is the row of the list.
    pub other: u32,
    /// Distance (m) at which they are held apart.
    pub thickness: f32,
}

/// The pairs of one kind, in a row for each first feature, with their multipliers.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// The start of each row, and the end of the last.
    pub starts: Vec<u32>,
    pub pairs: Vec<Listed>,
    /// Multipliers (kg m): xyz for friction, w along the normal.
    pub lambda: Vec<Vec4>,
}

/// The pairs that a task finds.
#[derive(Debug, Default)]
struct Found {
    /// Candidates of each kind: first and second feature.
    near: [Vec<[u32; 2]>; 2],
    /// Pairs to list, each with its first feature.
    listed: [Vec<(u32, Listed)>; 2],
}

/// Buffers that are reused between detections.
#[derive(Debug, Default)]
pub(super) struct Detection {
    /// Pairs of leaves within the cloth, and pairs of a leaf of the cloth and a leaf of the bodies.
    leaves: [Vec<[u32; 2]>; 2],
    /// Midpoints of the vertices' paths (m); w is the distance that they may stray from them.
    middle: Vec<Vec4>,
    /// Boxes around all points that triangles, edges and vertices may stray to from there.
    boxes: [Boxes; 3],
    found: Vec<Found>,
    before: Rows,
}

/// The input of a detection.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub surface: &'a Surface,
    /// Whether contact of the cloth with itself is on.
    pub meets_itself: bool,
    /// Whether bodies are where they were at the last detection.
    pub bodies_rest: bool,
    pub path: Path<'a>,
    pub look: Look,
    /// Thickness (m) of features that are far apart at rest.
    pub thickness: f32,
    pub width: Width,
}

impl Detection {
    /// Lists all pairs anew, with the multipliers of pairs that were listed before. Pairs that `is_let_go` accepts are
    /// left out. If there are too many pairs of leaves, returns their number as an error.
    pub(super) fn run(
        &mut self,
        scene: Scene<'_>,
        [cloth, bodies]: [&mut Tree; 2],
        lists: &mut [Rows; 2],
        is_let_go: impl Fn(Kind, u32, &Listed) -> bool,
    ) -> Result<(), usize> {
        let Scene { surface, path, look, .. } = scene;
        self.move_on(&scene);
        for (tree, rests) in [(&mut *cloth, false), (&mut *bodies, scene.bodies_rest)] {
            if !rests {
                self.bound(&scene, tree.leaves.all());
                tree.refit(surface, &self.boxes[TRIANGLES], path, look.substeps);
            }
        }
        let [own, across] = &mut self.leaves;
        own.clear();
        across.clear();
        if scene.meets_itself {
            cloth.walk(look, path.is_shared, own);
        }
        if surface.has_bodies() {
            cloth.walk_across(bodies, look, path.is_shared, across);
        }
        let pairs = own.len() + across.len();
        if pairs > CROWD[0] + (CROWD[1] << cloth.leaves.depth.max(bodies.leaves.depth)) {
            return Err(pairs);
        }
        let tasks = own.len().div_ceil(GRAIN) + across.len().div_ceil(GRAIN);
        if self.found.len() < tasks {
            self.found.resize_with(tasks, Found::default);
        }
        let (cloth, bodies, middle, boxes) = (&*cloth, &*bodies, &self.middle, &self.boxes);
        let (found_own, found_across) = self.found[..tasks].split_at_mut(own.len().div_ceil(GRAIN));
        for (leaves, found, other) in [(&*own, found_own, cloth), (&*across, found_across, bodies)] {
            let look = |(found, leaves): (&mut Found, &[[u32; 2]])| {
                found.near.iter_mut().for_each(Vec::clear);
                found.listed.iter_mut().for_each(Vec::clear);
                let (is_own, near) = (std::ptr::eq(cloth, other), &mut found.near);
                simd::run(scene.width, Candidates { scene: &scene, boxes, trees: [cloth, other], is_own, leaves, near });
                for kind in Kind::ALL {
                    let (near, listed) = (&found.near[kind as usize], &mut found.listed[kind as usize]);
                    simd::run(scene.width, Measure { scene: &scene, middle, kind, near, listed });
                }
            };
            if path.is_shared && found.len() > 1 {
                found.par_iter_mut().zip(leaves.par_chunks(GRAIN)).for_each(look);
            } else {
                found.iter_mut().zip(leaves.chunks(GRAIN)).for_each(look);
            }
        }
        for kind in Kind::ALL {
            let rows = match kind {
                Kind::VertexTriangle => path.x.len(),
                Kind::EdgeEdge => surface.edges.len(),
            };
            let found = &self.found[..tasks];
            let found = || {
                found.iter().flat_map(|found| &found.listed[kind as usize]).filter(|(row, listed)| !is_let_go(kind, *row, listed))
            };
            lists[kind as usize].fill(rows, found, &mut self.before);
        }
        Ok(())
    }

    /// Computes the midpoints of all vertices' paths.
    fn move_on(&mut self, scene: &Scene<'_>) {
        let Scene { path, look, .. } = *scene;
        self.middle.resize(path.x.len(), Vec4::ZERO);
        for_chunks(path.is_shared, &mut self.middle, GROUP, |first, middle| {
            let state = path.x[first..].iter().zip(&path.u[first..]).zip(&path.stray[first..]);
            middle.iter_mut().zip(state).for_each(|(y, ((&x, &u), &stray))| *y = (x + u * (0.5 * look.substeps)).with_w(stray));
        });
    }

    /// Computes the boxes of some triangles, edges and vertices.
    fn bound(&mut self, scene: &Scene<'_>, [triangles, edges, vertices]: [Range<usize>; 3]) {
        let Scene { surface, path, .. } = *scene;
        let middle = &self.middle;
        let around = |axis: usize, vertices: &[u32]| {
            vertices.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &vertex| {
                let y = middle[vertex as usize];
                [low.min(y[axis] - y.w), high.max(y[axis] + y.w)]
            })
        };
        let [of_triangles, of_edges, of_vertices] = &mut self.boxes;
        of_triangles.bound(triangles, path.is_shared, |axis, item| around(axis, &surface.triangles[item]));
        of_edges.bound(edges, path.is_shared, |axis, item| around(axis, &surface.edges[item]));
        of_vertices.bound(vertices, path.is_shared, |axis, item| around(axis, &surface.order[item..=item]));
    }
}

impl Rows {
    /// Becomes another list, in its own buffers.
    pub(super) fn copy_from(&mut self, other: &Rows) {
        self.starts.clone_from(&other.starts);
        self.pairs.clone_from(&other.pairs);
        self.lambda.clone_from(&other.lambda);
    }

    /// Removes all pairs.
    pub(super) fn clear(&mut self) {
        self.starts.clear();
        self.pairs.clear();
        self.lambda.clear();
    }

    /// Replaces the pairs, in the order of their rows, with the multipliers of pairs that were listed before.
    fn fill<'a, I: Iterator<Item = &'a (u32, Listed)>>(&mut self, rows: usize, found: impl Fn() -> I, before: &mut Rows) {
        std::mem::swap(self, before);
        self.starts.clear();
        self.starts.resize(rows + 1, 0);
        found().for_each(|(row, _)| self.starts[*row as usize + 1] += 1);
        let mut total = 0;
        for start in &mut self.starts {
            // For now each entry is the end of the row before it, that is, the start of its own row.
            total += std::mem::replace(start, total);
        }
        // Each entry is now the start of the row before its own; adding the pairs moves it to that row's end.
        let total = total as usize;
        self.pairs.clear();
        self.pairs.resize(total, Listed { corners: [0; 4], other: 0, thickness: 0.0 });
        self.lambda.clear();
        self.lambda.resize(total, Vec4::ZERO);
        for &(row, pair) in found() {
            let place = &mut self.starts[row as usize + 1];
            self.pairs[*place as usize] = pair;
            *place += 1;
        }
        if before.starts.len() == self.starts.len() {
            before.hand_on(self);
        }
    }

    /// Copies multipliers to the same pairs in another list.
    fn hand_on(&self, to: &mut Rows) {
        for (old, new) in self.starts.windows(2).zip(to.starts.windows(2)) {
            let (old, new) = (old[0] as usize..old[1] as usize, new[0] as usize..new[1] as usize);
            for index in old.filter(|&index| self.lambda[index] != Vec4::ZERO) {
                let other = self.pairs[index].other;
                let same = new.clone().find(|&place| to.pairs[place].other == other);
                same.into_iter().for_each(|place| to.lambda[place] = self.lambda[index]);
            }
        }
    }
}

/// Finds pairs of features of two leaves, or of one, whose boxes are within reach.
struct Candidates<'a> {
    scene: &'a Scene<'a>,
    boxes: &'a [Boxes; 3],
    trees: [&'a Tree; 2],
    /// Whether both trees are the same.
    is_own: bool,
    leaves: &'a [[u32; 2]],
    near: &'a mut [Vec<[u32; 2]>; 2],
}

impl Loop for Candidates<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Candidates { scene, boxes, trees: [cloth, others], is_own, leaves, near } = self;
        let surface = scene.surface;
        let [vertex_triangle, edge_edge] = near;
        for &[a, b] in leaves {
            let (one, other) = (cloth.leaf(a), others.leaf(b));
            let reach = one.reach(other, scene.look.margin, scene.look.substeps);
            let (of_a, of_b) = (&cloth.leaves, &others.leaves);
            let [a, b] = [a as usize, b as usize];
            let is_one = is_own && a == b;
            let (vertices, triangles) = (of_a.vertices_of(a), of_b.triangles_of(b));
            pierce::<L>(surface, boxes, [vertices, triangles], grown(other.place, reach), reach, vertex_triangle);
            if !is_one {
                let (vertices, triangles) = (of_b.vertices_of(b), of_a.triangles_of(a));
                pierce::<L>(surface, boxes, [vertices, triangles], grown(one.place, reach), reach, vertex_triangle);
            }
            let edges = [of_a.edges_of(a), of_b.edges_of(b)];
            meet::<L>(surface, &boxes[EDGES], edges, is_one, grown(other.place, reach), reach, edge_edge);
        }
    }
}

/// A box enlarged by `by`.
#[inline(always)]
fn grown([low, high]: [Vec3A; 2], by: Vec3A) -> [Vec3A; 2] {
    [low - by, high + by]
}

/// Pairs of vertices and triangles whose boxes are within `reach` of each other; vertices outside `place` are skipped.
#[inline(always)]
fn pierce<L: Registers>(
    surface: &Surface,
    boxes: &[Boxes; 3],
    [vertices, triangles]: [Range<usize>; 2],
    place: [Vec3A; 2],
    reach: Vec3A,
    near: &mut Vec<[u32; 2]>,
) {
    for first in vertices.clone().step_by(L::LANES) {
        let mut left = boxes[VERTICES].touching::<L>(first, vertices.end - first, place);
        while left != 0 {
            let item = first + left.trailing_zeros() as usize;
            left &= left - 1;
            let (vertex, around) = (surface.order[item], grown(boxes[VERTICES].get(item), reach));
            for first in triangles.clone().step_by(L::LANES) {
                let mut found = boxes[TRIANGLES].touching::<L>(first, triangles.end - first, around);
                while found != 0 {
                    let triangle = first + found.trailing_zeros() as usize;
                    found &= found - 1;
                    if !surface.triangles[triangle].contains(&vertex) {
                        near.push([vertex, triangle as u32]);
                    }
                }
            }
        }
    }
}

/// The same for edges and other edges, or the same edges.
#[inline(always)]
fn meet<L: Registers>(
    surface: &Surface,
    boxes: &Boxes,
    [edges, others]: [Range<usize>; 2],
    is_one: bool,
    place: [Vec3A; 2],
    reach: Vec3A,
    near: &mut Vec<[u32; 2]>,
) {
    for first in edges.clone().step_by(L::LANES) {
        let mut left = boxes.touching::<L>(first, edges.end - first, place);
        while left != 0 {
            let edge = first + left.trailing_zeros() as usize;
            left &= left - 1;
            let ([i, j], around) = (surface.edges[edge], grown(boxes.get(edge), reach));
            // Within the same edges each pair is visited once.
            let start = if is_one { edge + 1 } else { others.start };
            for first in (start..others.end).step_by(L::LANES) {
                let mut found = boxes.touching::<L>(first, others.end - first, around);
                while found != 0 {
                    let other = first + found.trailing_zeros() as usize;
                    found &= found - 1;
                    let [k, l] = surface.edges[other];
                    if i != k && i != l && j != k && j != l {
                        near.push([edge as u32, other as u32]);
                    }
                }
            }
        }
    }
}

/// The corners of a pair.
pub(super) fn corners(surface: &Surface, kind: Kind, [first, second]: [u32; 2]) -> [u32; 4] {
    match kind {
        Kind::VertexTriangle => {
            let [a, b, c] = surface.triangles[second as usize];
            [first, a, b, c]
        }
        Kind::EdgeEdge => {
            let ([a, b], [c, d]) = (surface.edges[first as usize], surface.edges[second as usize]);
            [a, b, c, d]
        }
    }
}

/// The weights of the closest points of pairs.
#[inline(always)]
pub(super) fn closest<L: Registers>(kind: Kind, x: [Vector<L>; 4]) -> [L; 4] {
    match kind {
        Kind::VertexTriangle => vertex_triangle(x),
        Kind::EdgeEdge => edge_edge(x),
    }
}

/// The vector between the closest points.
#[inline(always)]
pub(super) fn between<L: Registers>(weights: [L; 4], x: [Vector<L>; 4]) -> Vector<L> {
    x[3].mul_add(weights[3], x[2].mul_add(weights[2], x[1].mul_add(weights[1], x[0] * weights[0])))
}

#[inline(always)]
pub(super) fn square<L: Registers>(v: Vector<L>) -> L {
    v.dot(v)
}

/// Lists the candidates that are close enough.
struct Measure<'a> {
    scene: &'a Scene<'a>,
    middle: &'a [Vec4],
    kind: Kind,
    near: &'a [[u32; 2]],
    listed: &'a mut Vec<(u32, Listed)>,
}

impl Loop for Measure<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Measure { scene, middle, kind, near, listed } = self;
        let Scene { surface, path, look, thickness, .. } = *scene;
        let half = L::splat(0.5 * look.substeps);
        for group in near.chunks(L::LANES) {
            let mut places = [corners(surface, kind, group[0]); MAX_LANES];
            places.iter_mut().zip(group).for_each(|(place, &pair)| *place = corners(surface, kind, pair));
            let (y, u) = (corners_of::<L>(middle, &places), corners_of::<L>(path.u, &places));
            let apart = between(closest(kind, y), y);
            let distance = apart.dot(apart).sqrt();
            let mut relative = square(u[0] - u[2]).max(square(u[0] - u[3]));
            relative = match kind {
                Kind::VertexTriangle => relative.max(square(u[0] - u[1])),
                Kind::EdgeEdge => relative.max(square(u[1] - u[2])).max(square(u[1] - u[3])),
            };
            let (a, b) = (fourth_of::<L>(middle, &places, 0), fourth_of::<L>(middle, &places, 1));
            let (c, d) = (fourth_of::<L>(middle, &places, 2), fourth_of::<L>(middle, &places, 3));
            let stray = match kind {
                Kind::VertexTriangle => a + b.max(c).max(d),
                Kind::EdgeEdge => a.max(b) + c.max(d),
            };
            // The part of the distance that is left for the pair's thickness.
            let left = distance - stray - relative.sqrt() * half;
            if L::all(L::splat(thickness).lt(left)) {
                continue;
            }
            let x = corners_of::<L>(&surface.rest, &places);
            let apart = between(closest(kind, x), x);
            let at_rest = apart.dot(apart).sqrt();
            let mut numbers = [Vec4::ZERO; MAX_LANES];
            scattered(Vector::new(left, at_rest, left), &mut numbers);
            for ((&[first, second], &corners), numbers) in group.iter().zip(&places).zip(&numbers) {
                let together = surface.piece[corners[0] as usize] == surface.piece[corners[3] as usize];
                let thickness = if together { thickness.min(0.5 * numbers.y) } else { thickness };
                if numbers.x < thickness {
                    listed.push((first, Listed { corners, other: second, thickness }));
                }
            }
        }
    }
}
