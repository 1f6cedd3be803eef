//! Detection lists the pairs of features that may come closer than their thickness within some substeps.
//!
//! Features are compared at the midpoints of their straight predicted paths over these substeps. A pair is not listed
//! if its distance there exceeds the sum of its thickness, the distances that both may stray from their paths
//! ([`Path::margin`]), and half of their relative motion. When a vertex strays farther than assumed, it gets a new path, and
//! the pairs around it are listed anew, or all pairs if that happens to many. Lists are as long as necessary: no pair is
//! dropped.

pub(super) mod boxes;
mod broad_phase;
pub(super) mod narrow_phase;
pub(crate) mod paths;
pub(crate) mod rows;
pub(super) mod tree;

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{Vec3A, Vec4};

use super::detection::boxes::Boxes;
use super::detection::broad_phase::{Candidates, TRIANGLES};
use super::detection::narrow_phase::NarrowPhase;
use super::detection::rows::{FoundPairs, Rows};
use super::detection::tree::{DetectionScope, Tree, Walk};
use super::input::Path;
use super::ranges::Ranges;
use super::surface::Surface;
use super::surface::pairs::Listed;
use super::workers::Workers;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::Kind;
use crate::simd::{self, Width};

/// Pairs of leaves per task.
const LEAF_PAIRS_OF_TASK: usize = 32;
/// Least number of vertices that are worth a part of a loop.
const VERTICES_OF_PART: usize = 256;

/// Limit on the number of pairs of leaves: this many, plus this many per leaf. A heap has tens per leaf; a cloth in a
/// single point has all pairs.
const MAX_LEAF_PAIRS: [usize; 2] = [100_000, 512];
/// Limit on the number of listed pairs, each of which takes about 230 bytes: this many, plus this many per vertex. A cloth at rest
/// whose thickness is the largest that is allowed has a million; a sheet of 100 x 100 vertices that is twisted until its edges
/// are five times as long has 1150 per vertex.
const LISTED: [usize; 2] = [1 << 21, 1536];

/// The largest number of pairs that are listed of so many vertices.
pub(crate) fn max_listed(vertices: usize) -> usize {
    LISTED[0] + LISTED[1] * vertices
}

/// Whether a pair is left out, given its kind and its first feature. (One type for all, so that detection is compiled once.)
type Ignored<'a> = dyn Fn(Kind, u32, &Listed) -> bool + Sync + 'a;

/// The buffers of a task.
#[derive(Debug, Default)]
struct Finding {
    /// Candidates of each kind: first and second feature.
    near: [Vec<[u32; 2]>; 2],
    found: [FoundPairs; 2],
}

/// Buffers that are reused between detections.
#[derive(Debug, Default)]
pub(crate) struct Detection {
    /// Pairs of leaves within the cloth, and pairs of a leaf of the cloth and a leaf of the bodies.
    leaves: [Vec<[u32; 2]>; 2],
    /// Midpoints of the vertices' paths (m); w is the distance that they may stray from them.
    middle: Vec<Vec4>,
    /// Boxes around all points that triangles, edges and vertices may stray to from there.
    boxes: [Boxes; 3],
    findings: Vec<Finding>,
    before: Rows,
    /// The vertices that get new paths, and the pairs that were added to a list already.
    pub strayed: Vec<u32>,
    added: Vec<[u32; 2]>,
    /// Whether each vertex is a free one of a pair that presses.
    pub pressed: Vec<bool>,
    /// Whether the bounds belong to the paths.
    pub is_fitted: bool,
}

/// The input of a detection.
#[derive(Clone, Copy)]
pub(crate) struct DetectionInput<'a> {
    pub surface: &'a Surface,
    /// Whether bodies are where they were at the last detection.
    pub bodies_rest: bool,
    pub path: Path<'a>,
    pub scope: DetectionScope,
    pub width: Width,
}

impl Detection {
    /// Lists all pairs anew, with the multipliers of pairs that were listed before. Pairs that `is_ignored` accepts are
    /// left out. If there are too many pairs, returns their number as an error.
    pub(crate) fn run(
        &mut self,
        input: DetectionInput<'_>,
        [cloth, bodies]: [&mut Tree; 2],
        lists: &mut [Rows; 2],
        is_ignored: &Ignored<'_>,
    ) -> Result<(), usize> {
        self.fit(input, [cloth, bodies]);
        let tasks = self.find(input, [cloth, bodies], true, is_ignored)?;
        let (rows, ranges) = (rows(&input), ranges(&input));
        for (kind, lists) in lists.iter_mut().enumerate() {
            let found = || self.findings[..tasks].iter().map(|finding| &finding.found[kind]);
            lists.fill(rows[kind], ranges[kind], found, &mut self.before, input.path.workers);
        }
        Ok(())
    }

    /// Finds out which vertices belong to pairs that press.
    pub(crate) fn mark_pressed(&mut self, lists: &[Rows; 2], x: &[Vec4]) {
        self.pressed.clear();
        self.pressed.resize(x.len(), false);
        let vertices = lists.iter().flat_map(Rows::pressed).map(|vertex| vertex as usize);
        vertices.filter(|&vertex| x[vertex].w > 0.0).for_each(|vertex| self.pressed[vertex] = true);
    }

    /// Lists more pairs, after the vertices that `strayed` got new paths.
    pub(crate) fn run_around(
        &mut self,
        input: DetectionInput<'_>,
        strayed: &[u32],
        [cloth, bodies]: [&mut Tree; 2],
        lists: &mut [Rows; 2],
    ) -> Result<(), usize> {
        let DetectionInput { surface, path, scope, .. } = input;
        for &vertex in strayed {
            self.middle[vertex as usize] = midpoint(path, scope, vertex as usize);
        }
        let (of_cloth, of_bodies) = strayed.split_at(strayed.partition_point(|&vertex| surface.owner[vertex as usize] == 0));
        for (tree, vertices) in [(&mut *cloth, of_cloth), (&mut *bodies, of_bodies)] {
            tree.mark(vertices, surface);
            for leaf in tree.moved() {
                let (leaves, path) = (&tree.leaves, Path { workers: Workers::ALONE, ..path });
                let around = [leaves.triangles_of(leaf), leaves.edges_of(leaf), leaves.vertices_of(leaf)];
                self.bound(&DetectionInput { path, ..input }, around);
            }
            tree.refit_around(vertices, surface, &self.boxes[TRIANGLES], path, scope.substeps);
        }
        let tasks = self.find(input, [cloth, bodies], false, &|_, _, _| false)?;
        for (kind, lists) in lists.iter_mut().enumerate() {
            lists.append(self.findings[..tasks].iter().flat_map(|finding| &finding.found[kind].pairs), &mut self.added);
        }
        Ok(())
    }

    /// Fits all bounds to the paths.
    pub(crate) fn fit(&mut self, input: DetectionInput<'_>, trees: [&mut Tree; 2]) {
        let DetectionInput { surface, path, scope, .. } = input;
        self.middle.resize(path.x.len(), Vec4::ZERO);
        path.workers.chunks(&mut self.middle, VERTICES_OF_PART, |first, middle| {
            (first..).zip(middle).for_each(|(vertex, y)| *y = midpoint(path, scope, vertex));
        });
        for (tree, rests) in trees.into_iter().zip([false, input.bodies_rest]) {
            if !rests {
                self.bound(&input, tree.leaves.all());
                tree.refit(surface, &self.boxes[TRIANGLES], path, scope.substeps);
            }
        }
        self.is_fitted = true;
    }

    /// Finds all pairs, or only those that may be new. Returns the number of tasks that did.
    fn find(
        &mut self,
        input: DetectionInput<'_>,
        [cloth, bodies]: [&mut Tree; 2],
        all: bool,
        is_ignored: &Ignored<'_>,
    ) -> Result<usize, usize> {
        let DetectionInput { surface, path, scope, .. } = input;
        let workers = if all { path.workers } else { Workers::ALONE };
        let walk = Walk { scope, all, workers };
        let [own, across] = &mut self.leaves;
        own.clear();
        across.clear();
        if surface.has_self_contact {
            cloth.walk(walk, own);
        }
        if surface.has_bodies() {
            cloth.walk_across(bodies, walk, across);
        }
        let pairs = own.len() + across.len();
        if pairs > MAX_LEAF_PAIRS[0] + (MAX_LEAF_PAIRS[1] << cloth.leaves.depth.max(bodies.leaves.depth)) {
            return Err(pairs);
        }
        let tasks = own.len().div_ceil(LEAF_PAIRS_OF_TASK) + across.len().div_ceil(LEAF_PAIRS_OF_TASK);
        self.findings.resize_with(self.findings.len().max(tasks), Finding::default);
        let (findings, left) = self.findings[..tasks].split_at_mut(own.len().div_ceil(LEAF_PAIRS_OF_TASK));
        let (cloth, bodies, middle, boxes) = (&*cloth, &*bodies, &self.middle, &self.boxes);
        let ranges = ranges(&input);
        let (listed_in_all, most) = (AtomicUsize::new(0), max_listed(path.x.len()));
        for (leaves, findings, other) in [(&*own, findings, cloth), (&*across, left, bodies)] {
            let part = path.workers.small_part(findings.len());
            let parts = findings.chunks_mut(part).zip(leaves.chunks(part * LEAF_PAIRS_OF_TASK));
            path.workers.each(parts, |(findings, leaves)| {
                for (Finding { near, found }, leaves) in findings.iter_mut().zip(leaves.chunks(LEAF_PAIRS_OF_TASK)) {
                    if listed_in_all.load(Ordering::Relaxed) > most {
                        return;
                    }
                    near.iter_mut().for_each(Vec::clear);
                    let (trees, is_own) = ([cloth, other], std::ptr::eq(cloth, other));
                    simd::run(input.width, Candidates { surface, scope, boxes, trees, is_own, leaves, near });
                    for kind in Kind::ALL {
                        let FoundPairs { pairs: listed, ranges: of } = &mut found[kind as usize];
                        listed.clear();
                        let near = &near[kind as usize];
                        simd::run(input.width, NarrowPhase { surface, scope, middle, u: path.u, kind, near, listed });
                        listed.retain(|(row, pair)| !is_ignored(kind, *row, pair));
                        *of = listed.iter().fold(0, |all, (row, _)| all | ranges[kind as usize].bit(*row));
                        listed_in_all.fetch_add(listed.len(), Ordering::Relaxed);
                    }
                }
            });
        }
        // Whether there are too many does not depend on the order in which threads count them.
        if listed_in_all.into_inner() > most { Err(most) } else { Ok(tasks) }
    }

    /// Computes the boxes of some triangles, edges and vertices.
    fn bound(&mut self, input: &DetectionInput<'_>, [triangles, edges, vertices]: [Range<usize>; 3]) {
        let DetectionInput { surface, path, .. } = *input;
        let middle = &self.middle;
        let [of_triangles, of_edges, of_vertices] = &mut self.boxes;
        of_triangles.bound(triangles, path.workers, |item| box_around(middle, &surface.triangles[item]));
        of_edges.bound(edges, path.workers, |item| box_around(middle, &surface.edges[item]));
        of_vertices.bound(vertices, path.workers, |item| box_around(middle, &surface.order[item..=item]));
    }
}

/// The number of first features of pairs of each kind.
fn rows(input: &DetectionInput<'_>) -> [usize; 2] {
    [input.path.x.len(), input.surface.edges.len()]
}

/// The same, divided among the threads.
fn ranges(input: &DetectionInput<'_>) -> [Ranges; 2] {
    rows(input).map(|rows| Ranges::of(rows, 1, input.path.workers))
}

/// The midpoint of a vertex's path (m); w is the distance that it may stray from it.
fn midpoint(path: Path<'_>, scope: DetectionScope, vertex: usize) -> Vec4 {
    (path.x[vertex] + path.u[vertex] * (0.5 * scope.substeps)).with_w(path.margin[vertex])
}

/// The box around everything that some vertices may stray to from the midpoints of their paths.
fn box_around(middle: &[Vec4], vertices: &[u32]) -> [Vec3A; 2] {
    vertices.iter().fold([Vec3A::INFINITY, Vec3A::NEG_INFINITY], |[low, high], &vertex| {
        let (y, margin) = (xyz(middle[vertex as usize]), Vec3A::splat(middle[vertex as usize].w));
        [low.min(y - margin), high.max(y + margin)]
    })
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_detection.rs"]
mod tests;
