//! Detection: pairs of features that may come nearer than their thickness within some substeps, listed.
//!
//! Features are looked at in the middle of the straight paths that they are on, for so many substeps. A pair that is apart there by more
//! than its thickness, twice what either may stray from its path ([`STRAY`]) and half of what they move against each other is not met, and
//! not listed. When a vertex strays farther, everything is detected again. A list is as long as it need be: nothing is dropped.

use glam::{Vec3A, Vec4};
use rayon::prelude::*;

use super::lanes::{corners_of, scattered};
use super::surface::Surface;
use super::tree::{Look, Tree};
use super::{Path, for_chunks};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{edge_edge, vertex_triangle};
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector, Width};

/// Pairs of leaves that a task looks into.
const GRAIN: usize = 32;
/// Features that a task bounds.
const FEATURES: usize = 4096;
/// Features of a kind in a leaf, at most.
const MOST: usize = 24;

/// Pairs of leaves that are too many to look into: more than this, and for each leaf. A heap has tens for each; all cloth in one point has all.
const CROWD: [usize; 2] = [100_000, 512];

/// Which features a pair is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    VertexTriangle,
    EdgeEdge,
}

/// A pair that is listed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Listed {
    pub corners: [u32; 4],
    /// The first feature is the list's row; this is the second.
    pub other: u32,
    /// How near (m) they may come.
    pub thickness: f32,
}

/// The pairs of one kind by their first feature, a row each, with what holds each apart.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// Where each row begins, and the last ends.
    pub starts: Vec<u32>,
    pub pairs: Vec<Listed>,
    /// Multipliers (kg m): xyz along the friction, w along the normal.
    pub lambda: Vec<Vec4>,
}

/// Pairs that a task finds.
#[derive(Debug, Default)]
struct Found {
    /// Candidates of each kind: first and second feature.
    near: [Vec<[u32; 2]>; 2],
    /// Their first feature, and the rest.
    listed: [Vec<(u32, Listed)>; 2],
}

/// Buffers, kept from detection to detection.
#[derive(Debug, Default)]
pub(super) struct Detection {
    leaves: Vec<[u32; 2]>,
    /// Vertices in the middle of their paths (m), and what bounds each triangle and edge there.
    middle: Vec<Vec4>,
    triangles: Vec<[Vec3A; 2]>,
    edges: Vec<[Vec3A; 2]>,
    found: Vec<Found>,
    before: Rows,
}

/// What is looked at.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub surface: &'a Surface,
    pub rest: &'a [Vec4],
    pub path: Path<'a>,
    pub look: Look,
    /// Thickness (m) of what is far apart at rest.
    pub thickness: f32,
    pub width: Width,
}

impl Detection {
    /// Lists all pairs anew; what held a pair apart that was listed before is carried over. Pairs that `is_let_go` are left out. If there are too
    /// many pairs of leaves to look into, says how many.
    pub(super) fn run(
        &mut self,
        scene: Scene<'_>,
        tree: &mut Tree,
        lists: &mut [Rows; 2],
        is_let_go: impl Fn(Kind, u32, &Listed) -> bool,
    ) -> Result<(), usize> {
        tree.refit(scene.surface, scene.path, scene.look.substeps);
        tree.walk(scene.look, scene.path.is_shared, &mut self.leaves);
        if self.leaves.len() > CROWD[0] + (CROWD[1] << scene.surface.depth) {
            return Err(self.leaves.len());
        }
        let tasks = self.leaves.len().div_ceil(GRAIN);
        if self.found.len() < tasks {
            self.found.resize_with(tasks, Found::default);
        }
        if tasks > 0 {
            self.bound(&scene);
        }
        let tree = &*tree;
        let boxes = Boxes { middle: &self.middle, triangles: &self.triangles, edges: &self.edges };
        let look = |(found, leaves): (&mut Found, &[[u32; 2]])| {
            found.near.iter_mut().for_each(Vec::clear);
            found.listed.iter_mut().for_each(Vec::clear);
            leaves.iter().for_each(|&pair| candidates(&scene, boxes, tree, pair, &mut found.near));
            for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
                let (near, listed) = (&found.near[kind as usize], &mut found.listed[kind as usize]);
                simd::run(scene.width, Measure { scene: &scene, middle: boxes.middle, kind, near, listed });
            }
        };
        if scene.path.is_shared && tasks > 1 {
            self.found[..tasks].par_iter_mut().zip(self.leaves.par_chunks(GRAIN)).for_each(look);
        } else {
            self.found[..tasks].iter_mut().zip(self.leaves.chunks(GRAIN)).for_each(look);
        }
        for kind in [Kind::VertexTriangle, Kind::EdgeEdge] {
            let rows = match kind {
                Kind::VertexTriangle => scene.path.x.len(),
                Kind::EdgeEdge => scene.surface.edges.len(),
            };
            let found = &self.found[..tasks];
            let found = || {
                found.iter().flat_map(|found| &found.listed[kind as usize]).filter(|(row, listed)| !is_let_go(kind, *row, listed))
            };
            lists[kind as usize].fill(rows, found, &mut self.before);
        }
        Ok(())
    }

    /// Puts everything in the middle of its path.
    fn bound(&mut self, scene: &Scene<'_>) {
        let Scene { surface, path, look, .. } = *scene;
        let fit = |list: &mut Vec<[Vec3A; 2]>, count| list.resize(count, [Vec3A::ZERO; 2]);
        fit(&mut self.triangles, surface.triangles.len());
        fit(&mut self.edges, surface.edges.len());
        self.middle.resize(path.x.len(), Vec4::ZERO);
        for_chunks(path.is_shared, &mut self.middle, FEATURES, |first, middle| {
            let state = path.x[first..].iter().zip(&path.u[first..]);
            middle.iter_mut().zip(state).for_each(|(y, (&x, &u))| *y = x + u * (0.5 * look.substeps));
        });
        let middle = &self.middle;
        let at = |vertex: u32| xyz(middle[vertex as usize]);
        for_chunks(path.is_shared, &mut self.triangles, FEATURES, |first, boxes| {
            for (bounds, corners) in boxes.iter_mut().zip(&surface.triangles[first..]) {
                let [a, b, c] = corners.map(at);
                *bounds = [a.min(b).min(c), a.max(b).max(c)];
            }
        });
        for_chunks(path.is_shared, &mut self.edges, FEATURES, |first, boxes| {
            for (bounds, ends) in boxes.iter_mut().zip(&surface.edges[first..]) {
                let [a, b] = ends.map(at);
                *bounds = [a.min(b), a.max(b)];
            }
        });
    }
}

impl Rows {
    /// Lists nothing.
    pub(super) fn clear(&mut self) {
        self.starts.clear();
        self.pairs.clear();
        self.lambda.clear();
    }

    /// Takes pairs, row by row as they come, with the multipliers of those that were there.
    fn fill<'a, I: Iterator<Item = &'a (u32, Listed)>>(&mut self, rows: usize, found: impl Fn() -> I, before: &mut Rows) {
        std::mem::swap(self, before);
        self.starts.clear();
        self.starts.resize(rows + 1, 0);
        found().for_each(|(row, _)| self.starts[*row as usize + 1] += 1);
        let mut total = 0;
        for start in &mut self.starts {
            // Where the row before ends for now is where this one begins.
            total += std::mem::replace(start, total);
        }
        // Each is now where the row before its own begins.
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

    /// Gives multipliers to the same pairs in another list.
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

/// Where things are in the middle of their paths.
#[derive(Clone, Copy)]
struct Boxes<'a> {
    middle: &'a [Vec4],
    triangles: &'a [[Vec3A; 2]],
    edges: &'a [[Vec3A; 2]],
}

/// Features of a leaf within reach of a box.
struct Near<const N: usize> {
    items: [(u32, [Vec3A; 2]); N],
    count: usize,
}

impl<const N: usize> Near<N> {
    fn new(items: impl Iterator<Item = (u32, [Vec3A; 2])>, of: [Vec3A; 2], reach: Vec3A) -> Near<N> {
        let mut near = Near { items: [(0, [Vec3A::ZERO; 2]); N], count: 0 };
        for (item, bounds) in items.filter(|(_, bounds)| !is_apart(*bounds, of, reach)) {
            near.items[near.count] = (item, bounds);
            near.count += 1;
        }
        near
    }

    fn list(&self) -> &[(u32, [Vec3A; 2])] {
        &self.items[..self.count]
    }
}

fn is_apart(a: [Vec3A; 2], b: [Vec3A; 2], reach: Vec3A) -> bool {
    (a[0] - b[1]).max(b[0] - a[1]).cmpgt(reach).any()
}

/// Pairs of features of two leaves, or of one, whose boxes are within reach.
fn candidates(scene: &Scene<'_>, boxes: Boxes<'_>, tree: &Tree, [a, b]: [u32; 2], near: &mut [Vec<[u32; 2]>; 2]) {
    let Scene { surface, look, .. } = *scene;
    let first = 1_usize << surface.depth;
    let (one, other) = (&tree.nodes[first + a as usize], &tree.nodes[first + b as usize]);
    let reach = one.reach(other, look.margin, look.substeps);
    let vertices = |leaf: u32, of| {
        let items = surface.vertices_of.of(leaf).iter();
        Near::<MOST>::new(items.map(|&vertex| (vertex, [xyz(boxes.middle[vertex as usize]); 2])), of, reach)
    };
    let triangles = |leaf: u32, of| {
        let items = surface.leaf(leaf as usize);
        Near::<MOST>::new(items.map(|triangle| (triangle as u32, boxes.triangles[triangle])), of, reach)
    };
    let edges = |leaf: u32, of| {
        let items = surface.edges_of.of(leaf).iter();
        Near::<MOST>::new(items.map(|&edge| (edge, boxes.edges[edge as usize])), of, reach)
    };
    let [vertex_triangle, edge_edge] = near;
    let mut pierce = |vertices: &Near<MOST>, triangles: &Near<MOST>| {
        for &(vertex, at) in vertices.list() {
            let near = triangles.list().iter().filter(|(_, bounds)| !is_apart(at, *bounds, reach));
            let near = near.filter(|(triangle, _)| !surface.triangles[*triangle as usize].contains(&vertex));
            vertex_triangle.extend(near.map(|&(triangle, _)| [vertex, triangle]));
        }
    };
    pierce(&vertices(a, other.place), &triangles(b, one.place));
    if a != b {
        pierce(&vertices(b, one.place), &triangles(a, other.place));
    }
    let (of_a, of_b) = (edges(a, other.place), edges(b, one.place));
    for (index, &(edge, at)) in of_a.list().iter().enumerate() {
        let others = if a == b { &of_b.list()[index + 1..] } else { of_b.list() };
        let [i, j] = surface.edges[edge as usize];
        let near = others.iter().filter(|(_, bounds)| !is_apart(at, *bounds, reach));
        let near = near.filter(|(other, _)| {
            let [k, l] = surface.edges[*other as usize];
            i != k && i != l && j != k && j != l
        });
        edge_edge.extend(near.map(|&(other, _)| [edge.min(other), edge.max(other)]));
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

/// The weights of the closest points of pairs of a kind.
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

/// Lists candidates that are near enough.
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
        let Scene { surface, rest, path, look, thickness, .. } = *scene;
        let (half, margin) = (L::splat(0.5 * look.substeps), L::splat(look.margin - thickness));
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
            // What is left of the distance for the pair's own thickness.
            let left = distance - margin - relative.sqrt() * half;
            if L::all(L::splat(thickness).lt(left)) {
                continue;
            }
            let x = corners_of::<L>(rest, &places);
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
