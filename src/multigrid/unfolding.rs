//! Distances in unfolded cloth, where the rest shape has pleats or wrinkles: its triangles are laid side by side into a plane.
//!
//! The centers of two aggregates can be as far apart as in the unfolded cloth, which in pleats is several times as far as at rest.
//! Coarse edges as long as at rest would hold pleats together like rubber bands: a pleated skirt that hangs open would gain 8 J when it
//! begins to use levels. Where pleated cloth cannot be unfolded, because it goes around a tube, it has no coarse edges.

use glam::{DVec2, DVec3};

use crate::model::cloth::Cloth;
use crate::model::csr::{Csr, distinct};
use crate::multigrid::aggregation::{Aggregate, CROWDED, neighbors};

/// An aggregate is folded if the lengths of its area-weighted normals add up to so much more than their sum has. Of a part of a
/// cylinder this is an angle of 63 degrees.
const FOLDED: f64 = 0.95;
/// The cosine of the angle between the normals of two aggregates from which the cloth is folded between them.
const BENT: f64 = 0.9;
/// An aggregate that is unfolded beginning at another one is torn if its radius (root mean square) is so many times that of itself
/// unfolded alone.
const TORN: f64 = 1.25;

/// A triangle is torn if an edge is so many times as long in the plane.
const LONGER: f64 = 1.5;

/// What is known of the distance between the centers of two aggregates in the unfolded cloth.
#[derive(Clone, Copy)]
pub(crate) enum Unfolded {
    /// The cloth is hardly folded there.
    Flat,
    /// The distance (m).
    At(f64),
    /// The cloth cannot be unfolded there.
    Torn,
}

/// A cloth whose triangles are laid into a plane.
pub(crate) struct Unfolding<'a> {
    cloth: &'a Cloth,
    /// The triangles around each vertex, and those that share an edge with each triangle.
    around: Csr<u32>,
    beyond: Csr<u32>,
    /// Where vertices are in the plane (m).
    at: Vec<DVec2>,
    /// The number of the unfolding in which a vertex was last placed, and a triangle visited.
    placed: Vec<u32>,
    visited: Vec<u32>,
    /// The same for the aggregates whose triangles were laid.
    among: Vec<u32>,
    number: u32,
}

/// The aggregates of a level.
pub(crate) struct OfLevel<'a> {
    /// The aggregate of each vertex.
    aggregate_of: &'a [u32],
    /// The vertices of each aggregate.
    vertices: Csr<u32>,
    /// The aggregates that share fine edges with each.
    neighbors: Csr<u32>,
    /// Whether each is folded, or between it and a neighbor.
    folded: Vec<bool>,
}

impl<'a> OfLevel<'a> {
    pub(crate) fn new(aggregates: &'a [Aggregate], aggregate_of: &'a [u32], pairs: &[[u32; 2]]) -> OfLevel<'a> {
        let count = aggregates.len();
        let are_apart = |[a, b]: [&Aggregate; 2]| a.normal.dot(b.normal) < BENT * a.normal.length() * b.normal.length();
        let mut folded: Vec<bool> = aggregates.iter().map(|of| of.normal.length() < FOLDED * of.area).collect();
        for &pair in pairs.iter().filter(|pair| are_apart(pair.map(|aggregate| &aggregates[aggregate as usize]))) {
            pair.into_iter().for_each(|aggregate| folded[aggregate as usize] = true);
        }
        OfLevel {
            aggregate_of,
            vertices: Csr::new(count, aggregate_of.iter().copied().zip(0..)),
            neighbors: neighbors(count, pairs),
            folded,
        }
    }

    fn is_folded(&self, pair: [u32; 2]) -> bool {
        pair.into_iter().any(|aggregate| self.folded[aggregate as usize])
    }
}

impl<'a> Unfolding<'a> {
    fn new(cloth: &'a Cloth) -> Unfolding<'a> {
        let (vertices, triangles) = (cloth.rest.len(), cloth.triangles.len());
        let corners = (0..).zip(&cloth.triangles).flat_map(|(triangle, corners)| corners.map(|corner| (corner, triangle)));
        let around = Csr::new(vertices, corners);
        let edges = (0..)
            .zip(&cloth.triangles)
            .flat_map(|(triangle, &[a, b, c])| [[a, b], [b, c], [c, a]].map(|[u, v]| [u.min(v), u.max(v), triangle]));
        let edges = distinct(edges.collect());
        // Any number of triangles may share an edge: each is next to the one before and the one after it.
        let shared = edges.windows(2).filter(|pair| pair[0][..2] == pair[1][..2]);
        let beyond = shared.flat_map(|pair| [(pair[0][2], pair[1][2]), (pair[1][2], pair[0][2])]);
        let beyond = Csr::new(triangles, beyond);
        Unfolding {
            cloth,
            around,
            beyond,
            at: vec![DVec2::ZERO; vertices],
            placed: vec![0; vertices],
            visited: vec![0; triangles],
            among: Vec::new(),
            number: 0,
        }
    }

    /// Each of the pairs of aggregates, which are sorted, with their distance. What is flat needs no unfolding.
    pub(crate) fn distances(
        this: &mut Option<Unfolding<'a>>,
        cloth: &'a Cloth,
        level: &OfLevel<'_>,
        pairs: &[[u32; 2]],
    ) -> Vec<([u32; 2], Unfolded)> {
        let mut distances: Vec<_> = pairs.iter().map(|&pair| (pair, Unfolded::Flat)).collect();
        if level.folded.contains(&true) {
            this.get_or_insert_with(|| Unfolding::new(cloth)).unfold_folded(level, &mut distances);
        }
        distances
    }

    fn unfold_folded(&mut self, level: &OfLevel<'_>, distances: &mut [([u32; 2], Unfolded)]) {
        let mut radii: Vec<Option<f64>> = vec![None; level.folded.len()];
        for with_first in distances.chunk_by_mut(|(a, _), (b, _)| a[0] == b[0]) {
            if !with_first.iter().any(|&(pair, _)| level.is_folded(pair)) {
                continue;
            }
            let first = with_first[0].0[0];
            let seconds: Vec<u32> = with_first.iter().map(|(pair, _)| pair[1]).collect();
            for &aggregate in seconds.iter().chain([&first]) {
                radii[aggregate as usize].get_or_insert_with(|| {
                    let laid = self.unfold(level, aggregate, &[]);
                    let radius = self.center_and_radius(level, aggregate).map(|(_, radius)| radius);
                    radius.filter(|_| self.are_whole(&laid)).unwrap_or(f64::INFINITY)
                });
            }
            self.unfold(level, first, &[&seconds, level.neighbors.of(first)]);
            let is_torn = |aggregate: u32, radius: f64| radii[aggregate as usize].is_some_and(|alone| radius > TORN * alone);
            let goes_around = |aggregate: u32| radii[aggregate as usize] == Some(f64::INFINITY);
            let Some((from, radius)) = self.center_and_radius(level, first) else { continue };
            for ([_, second], unfolded) in with_first.iter_mut().filter(|(pair, _)| level.is_folded(*pair)) {
                let Some((to, other)) = self.center_and_radius(level, *second) else { continue };
                if goes_around(first) || goes_around(*second) {
                    continue;
                }
                let is_torn = is_torn(first, radius) || is_torn(*second, other);
                *unfolded = if is_torn { Unfolded::Torn } else { Unfolded::At(from.distance(to)) };
            }
        }
    }

    /// Lays the triangles with a corner in an aggregate or one of others into the plane, beginning in the `first`, each next to one that
    /// was laid before. Returns them. The hub of a fan is left out of the others, because it has a corner of all triangles around it.
    fn unfold(&mut self, level: &OfLevel<'_>, first: u32, others: &[&[u32]]) -> Vec<u32> {
        self.number += 1;
        self.among.resize(level.folded.len().max(self.among.len()), 0);
        let is_hub = |aggregate: u32| level.neighbors.of(aggregate).len() > CROWDED;
        for &aggregate in others.iter().copied().flatten().filter(|&&other| !is_hub(other)).chain([&first]) {
            self.among[aggregate as usize] = self.number;
        }
        let triangles = &self.cloth.triangles;
        let number = self.number;
        let is_among = |corners: &[u32; 3], among: &[u32]| {
            corners.iter().any(|&corner| among[level.aggregate_of[corner as usize] as usize] == number)
        };
        let Some(&start) = level.vertices.of(first).iter().find_map(|&vertex| self.around.of(vertex).first()) else {
            return Vec::new();
        };
        let [a, b, c] = triangles[start as usize];
        let along = self.rest(b).distance(self.rest(a));
        (self.at[a as usize], self.at[b as usize]) = (DVec2::ZERO, DVec2::new(along, 0.0));
        self.at[c as usize] = self.beside([a, b], c, DVec2::NEG_Y);
        [a, b, c].into_iter().for_each(|vertex| self.placed[vertex as usize] = self.number);
        self.visited[start as usize] = self.number;
        let mut queue = vec![start];
        let mut next = 0;
        while let Some(&triangle) = queue.get(next) {
            next += 1;
            let corners = triangles[triangle as usize];
            for place in self.beyond.spans[triangle as usize].range() {
                let other = self.beyond.items[place];
                let others = triangles[other as usize];
                if self.visited[other as usize] == number || !is_among(&others, &self.among) {
                    continue;
                }
                self.visited[other as usize] = number;
                queue.push(other);
                let [opposite, apex] = [(corners, others), (others, corners)].map(|(of, not)| apex(of, not));
                if self.placed[apex as usize] != number {
                    let mut edge = others.into_iter().filter(|&corner| corner != apex);
                    if let (Some(u), Some(v)) = (edge.next(), edge.next()) {
                        self.at[apex as usize] = self.beside([u, v], apex, self.at[opposite as usize]);
                        self.placed[apex as usize] = number;
                    }
                }
            }
        }
        queue
    }

    /// Whether no triangle was torn, as where cloth that goes around a tube is laid out from both sides.
    fn are_whole(&self, triangles: &[u32]) -> bool {
        triangles.iter().all(|&triangle| {
            let [a, b, c] = self.cloth.triangles[triangle as usize];
            [[a, b], [b, c], [c, a]]
                .into_iter()
                .all(|[u, v]| self.at[u as usize].distance(self.at[v as usize]) <= LONGER * self.rest(u).distance(self.rest(v)))
        })
    }

    /// Where the third corner of a triangle is in the plane, on the other side of the edge than `opposite`.
    fn beside(&self, [u, v]: [u32; 2], apex: u32, opposite: DVec2) -> DVec2 {
        let [edge, to] = [v, apex].map(|vertex| self.rest(vertex) - self.rest(u));
        let (start, in_plane) = (self.at[u as usize], self.at[v as usize] - self.at[u as usize]);
        let share = to.dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE);
        let height = (to - edge * share).length();
        let across = in_plane.perp().normalize_or_zero();
        let side = if across.dot(opposite - start) > 0.0 { -1.0 } else { 1.0 };
        start + in_plane * share + across * (side * height)
    }

    fn rest(&self, vertex: u32) -> DVec3 {
        self.cloth.rest[vertex as usize].truncate().as_dvec3()
    }

    /// The center of mass of an aggregate in the plane, and its radius of gyration (m), if all of it is there.
    fn center_and_radius(&self, level: &OfLevel<'_>, aggregate: u32) -> Option<(DVec2, f64)> {
        let (mut mass, mut center, mut square) = (0.0, DVec2::ZERO, 0.0);
        for &vertex in level.vertices.of(aggregate) {
            let (of_vertex, at) = (f64::from(self.cloth.mass[vertex as usize]), self.at[vertex as usize]);
            if self.placed[vertex as usize] != self.number {
                return None;
            }
            (mass, center, square) = (mass + of_vertex, center + at * of_vertex, square + at.length_squared() * of_vertex);
        }
        center /= mass;
        Some((center, (square / mass - center.length_squared()).max(0.0).sqrt()))
    }
}

/// The corner of a triangle that is not one of another one's, with which it shares an edge.
fn apex(of: [u32; 3], other: [u32; 3]) -> u32 {
    of.into_iter().find(|corner| !other.contains(corner)).unwrap_or(of[0])
}
