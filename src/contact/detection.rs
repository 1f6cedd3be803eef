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
use super::candidates::{Candidates, TRIANGLES};
use super::measure::Measure;
use super::pairs::{Kind, Listed};
use super::ranges::Ranges;
use super::rows::{Found, Rows};
use super::surface::Surface;
use super::tree::{Look, Tree};
use super::{Path, for_chunks, least};
use crate::kernels::integrate::xyz;
use crate::simd::{self, Width};

/// Pairs of leaves per task.
const GRAIN: usize = 32;
/// Vertices per task when computing midpoints.
const GROUP: usize = 4096;

/// Limit on the number of pairs of leaves: this many, plus this many per leaf. A heap has tens per leaf; a cloth in a
/// single point has all pairs.
const CROWD: [usize; 2] = [100_000, 512];

/// The buffers of a task.
#[derive(Debug, Default)]
struct Finding {
    /// Candidates of each kind: first and second feature.
    near: [Vec<[u32; 2]>; 2],
    found: [Found; 2],
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
    findings: Vec<Finding>,
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
        is_let_go: impl Fn(Kind, u32, &Listed) -> bool + Sync,
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
        self.findings.resize_with(self.findings.len().max(tasks), Finding::default);
        let (findings, left) = self.findings[..tasks].split_at_mut(own.len().div_ceil(GRAIN));
        let (cloth, bodies, middle, boxes) = (&*cloth, &*bodies, &self.middle, &self.boxes);
        let rows = [path.x.len(), surface.edges.len()];
        let ranges = rows.map(|rows| Ranges::of(rows, path.is_shared));
        for (leaves, findings, other) in [(&*own, findings, cloth), (&*across, left, bodies)] {
            let tasks = findings.par_iter_mut().zip(leaves.par_chunks(GRAIN)).with_min_len(least(path.is_shared));
            tasks.for_each(|(Finding { near, found }, leaves)| {
                near.iter_mut().for_each(Vec::clear);
                let (trees, is_own) = ([cloth, other], std::ptr::eq(cloth, other));
                simd::run(scene.width, Candidates { surface, look, boxes, trees, is_own, leaves, near });
                for kind in Kind::ALL {
                    let Found { pairs: listed, ranges: of } = &mut found[kind as usize];
                    listed.clear();
                    simd::run(
                        scene.width,
                        Measure { surface, look, middle, u: path.u, kind, near: &near[kind as usize], listed },
                    );
                    listed.retain(|(row, pair)| !is_let_go(kind, *row, pair));
                    *of = listed.iter().fold(0, |all, (row, _)| all | ranges[kind as usize].bit(*row));
                }
            });
        }
        for (kind, lists) in lists.iter_mut().enumerate() {
            let found = || self.findings[..tasks].iter().map(|finding| &finding.found[kind]);
            lists.fill(rows[kind], ranges[kind], found, &mut self.before, path.is_shared);
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
        let around = |vertices: &[u32]| {
            vertices.iter().fold([Vec3A::INFINITY, Vec3A::NEG_INFINITY], |[low, high], &vertex| {
                let (y, stray) = (xyz(middle[vertex as usize]), Vec3A::splat(middle[vertex as usize].w));
                [low.min(y - stray), high.max(y + stray)]
            })
        };
        let [of_triangles, of_edges, of_vertices] = &mut self.boxes;
        of_triangles.bound(triangles, path.is_shared, |item| around(&surface.triangles[item]));
        of_edges.bound(edges, path.is_shared, |item| around(&surface.edges[item]));
        of_vertices.bound(vertices, path.is_shared, |item| around(&surface.order[item..=item]));
    }
}
