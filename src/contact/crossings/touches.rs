//! Intersections that are mere touches: exact, or off by rounding only.
//!
//! A contour along which surfaces intersect is a touch if one of the two can be moved out of the other by a multiple of
//! the distance that counts as touching. The search moves the vertices of one side of the contour, and then also those
//! of what it still intersects. Where surfaces really intersect this does not end, because the intersection moves on to
//! features that are intersected deeply.

use std::collections::BTreeMap;

use glam::DVec3;

use super::Features;
use super::contours::contours;
use super::overlaps::{box_around, overlap};

/// Length of the moves, in units of the distance that counts as touching.
const MOVE: f64 = 2.0;
/// Most rounds of moves for one contour.
const ROUNDS: usize = 64;
/// Limit on the pairs of an edge and a triangle whose boxes overlap: this many, plus this many per edge. A sheet that is twisted until
/// its edges are five times as long has hundreds per edge; cloth in a single point has all pairs.
const MAX_PAIRS: [usize; 2] = [10_000_000, 4096];
/// Room for pairs of boxes that are compared, besides a share for each feature. It suffices for anything but cloth that is
/// crammed into one place, of which all intersections count.
const ROOM: [usize; 2] = [1_000_000, 256];

impl Features<'_> {
    /// Finds the pairs of an edge and a triangle that intersect and share no vertex, as indices in sorted order. If there are more
    /// than [`MAX_PAIRS`] to test, returns that number as an error: detection finds too many pairs then, too.
    pub(crate) fn crossings(self) -> Result<Vec<[u32; 2]>, usize> {
        let (x, normals) = self.in_general_position();
        let most = MAX_PAIRS[0] + MAX_PAIRS[1] * self.edges.len();
        let mut room = most;
        let found = self.pierced(&x, &mut room);
        if room == 0 { Err(most) } else { Ok(Touches::new(self, x, normals).left_out_of(found)) }
    }
}

/// The search for touches.
pub(crate) struct Touches<'a> {
    features: Features<'a>,
    /// Positions (m) in general position; what touches is moved apart.
    pub x: Vec<DVec3>,
    /// Unit normals of the vertices.
    normals: Vec<DVec3>,
    /// The distance (m) that counts as touching.
    touching: f64,
    room: usize,
}

/// An intersection, and whether it is the edge that is to be moved, or the triangle.
type Move = ([u32; 2], bool);

impl<'a> Touches<'a> {
    pub(crate) fn new(features: Features<'a>, x: Vec<DVec3>, normals: Vec<DVec3>) -> Self {
        let room = ROOM[0] + ROOM[1] * features.triangles.len();
        Touches { touching: features.touching(), features, x, normals, room }
    }

    /// The intersections that are no touches.
    pub(crate) fn left_out_of(&mut self, mut found: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
        found.retain(|&crossing| !self.is_tiny(crossing));
        let mut flat: Vec<bool> = found.iter().map(|&crossing| self.way_out(crossing, true, 1.0).is_some()).collect();
        if !flat.contains(&true) {
            return found;
        }
        let mut is_touch = vec![false; found.len()];
        let at_edges = self.at_edges(&found);
        for contour in contours(&found, |edge| at_edges.get(&edge).map_or(&[], Vec::as_slice)) {
            let is_flat = contour.iter().all(|&(crossing, _)| std::mem::take(&mut flat[crossing]));
            if is_flat && contour.iter().any(|&(crossing, _)| !is_touch[crossing]) {
                let moved = self.part(contour.iter().map(|&(crossing, side)| (found[crossing], side > 0.0)).collect());
                if moved.is_empty() {
                    continue;
                }
                let is_moved = |vertices: &[u32]| vertices.iter().any(|vertex| moved.contains_key(vertex));
                for (is_touch, &crossing) in is_touch.iter_mut().zip(&found) {
                    let (ends, corners) = self.vertices(crossing);
                    *is_touch |= is_moved(&ends) || is_moved(&corners);
                }
            }
        }
        found.into_iter().zip(is_touch).filter(|(_, is_touch)| !is_touch).map(|(crossing, _)| crossing).collect()
    }

    fn vertices(&self, [edge, triangle]: [u32; 2]) -> ([u32; 2], [u32; 3]) {
        (self.features.edges[edge as usize], self.features.triangles[triangle as usize])
    }

    /// Whether the edge or the triangle is shorter than what counts as touching.
    fn is_tiny(&self, crossing: [u32; 2]) -> bool {
        let (ends, corners) = self.vertices(crossing);
        let is_tiny = |vertices: &[u32]| {
            let [low, high] = box_around(&vertices.iter().map(|&vertex| self.x[vertex as usize]).collect::<Vec<_>>(), 0.0);
            (high - low).max_element() < self.touching
        };
        is_tiny(&ends) || is_tiny(&corners)
    }

    /// The triangles at the edges that intersect something.
    fn at_edges(&self, found: &[[u32; 2]]) -> BTreeMap<u32, Vec<u32>> {
        let key = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
        let edges: BTreeMap<[u32; 2], u32> =
            found.iter().map(|&[edge, _]| (key(self.features.edges[edge as usize]), edge)).collect();
        let mut at_edges = BTreeMap::<u32, Vec<u32>>::new();
        for (triangle, &[a, b, c]) in (0..).zip(self.features.triangles) {
            for edge in [[a, b], [b, c], [c, a]].into_iter().filter_map(|side| edges.get(&key(side))) {
                at_edges.entry(*edge).or_default().push(triangle);
            }
        }
        at_edges
    }

    /// Moves one side of a contour out of the other. Returns the moved vertices, none if that is impossible.
    fn part(&mut self, contour: Vec<Move>) -> BTreeMap<u32, DVec3> {
        if self.room == 0 {
            return BTreeMap::new();
        }
        // First the side that is moved in front of the other: see `Features::in_general_position`.
        let (ends, corners) = self.vertices(contour[0].0);
        let is_first = (corners[0] as usize) >= self.features.cloth_vertices
            || (ends[0] as usize) < self.features.cloth_vertices && ends[0] > corners[0];
        for (side, way) in [(is_first, 1.0), (is_first, -1.0), (!is_first, 1.0), (!is_first, -1.0)] {
            let moves = contour.iter().map(|&(crossing, is_edge)| (crossing, is_edge == (contour[0].1 == side))).collect();
            if let Some((moved, x)) = self.parted(moves, way) {
                self.x = x;
                return moved;
            }
        }
        BTreeMap::new()
    }

    /// Tries to move one side, to the front of the other if `way` is 1, to its back if -1.
    fn parted(&mut self, mut moves: Vec<Move>, way: f64) -> Option<(BTreeMap<u32, DVec3>, Vec<DVec3>)> {
        let mut moved = BTreeMap::<u32, DVec3>::new();
        for _ in 0..ROUNDS {
            let before = moved.len();
            for (crossing, is_edge) in moves {
                let by = self.way_out(crossing, is_edge, way)?;
                let (ends, corners) = self.vertices(crossing);
                let vertices = if is_edge { &ends[..] } else { &corners };
                vertices.iter().for_each(|&vertex| *moved.entry(vertex).or_default() += by);
            }
            if moved.len() == before {
                return None;
            }
            let mut x = self.x.clone();
            for (&vertex, by) in &moved {
                x[vertex as usize] += by.normalize_or_zero() * (MOVE * self.touching);
            }
            let [edges, triangles] = [self.features.edges.len(), self.features.triangles.len()];
            self.room = self.room.saturating_sub(edges + triangles);
            let mut room = self.room;
            let hit = self.hit(&moved, &x, &mut room);
            self.room = room;
            moves = hit?;
            if moves.is_empty() {
                return Some((moved, x));
            }
        }
        None
    }

    /// What moved features intersect at `x` (m); `None` if they intersect each other, or if there is no more room.
    fn hit(&self, moved: &BTreeMap<u32, DVec3>, x: &[DVec3], room: &mut usize) -> Option<Vec<Move>> {
        let is_moved = |vertices: &[u32]| vertices.iter().any(|vertex| moved.contains_key(vertex));
        let at = |vertex: u32| x[vertex as usize];
        let Features { edges, triangles, .. } = self.features;
        let corners = triangles.iter().filter(|corners| is_moved(*corners)).flatten().map(|&vertex| at(vertex));
        let place = box_around(&corners.collect::<Vec<_>>(), 0.0);
        let near_edges: Vec<u32> =
            (0..).zip(edges).filter(|(_, ends)| overlap(&box_around(&ends.map(at), 0.0), &place)).map(|(edge, _)| edge).collect();
        let near_triangles: Vec<u32> = (0..)
            .zip(triangles)
            .filter(|(_, corners)| overlap(&box_around(&corners.map(at), 0.0), &place))
            .map(|(t, _)| t)
            .collect();
        let ends: Vec<[u32; 2]> = near_edges.iter().map(|&edge| edges[edge as usize]).collect();
        let corners: Vec<[u32; 3]> = near_triangles.iter().map(|&triangle| triangles[triangle as usize]).collect();
        let near = Features { edges: &ends, triangles: &corners, is_shared: false, ..self.features };
        let found = near.pierced(x, room);
        if *room == 0 {
            return None;
        }
        let named = found.iter().map(|&[edge, triangle]| [near_edges[edge as usize], near_triangles[triangle as usize]]);
        let moves = named.filter_map(|crossing| {
            let (ends, corners) = self.vertices(crossing);
            match [is_moved(&ends), is_moved(&corners)] {
                [false, false] => None,
                [true, true] => Some(None),
                [is_edge, _] => Some(Some((crossing, is_edge))),
            }
        });
        moves.collect()
    }

    /// The direction in which an edge leaves a triangle that it intersects hardly, or the triangle leaves the edge;
    /// `None` if it intersects it deeply.
    ///
    /// An edge that ends at the triangle leaves it to its front if `way` is 1, to its back if -1; one that passes
    /// beside a side of the triangle leaves it over that side.
    fn way_out(&self, crossing: [u32; 2], is_edge: bool, way: f64) -> Option<DVec3> {
        let at = |vertex: u32| self.x[vertex as usize];
        let (ends, corners) = self.vertices(crossing);
        let ([p, q], [a, b, c]) = (ends.map(at), corners.map(at));
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let heights = [p, q].map(|end| (end - a).dot(normal));
        if heights.iter().any(|height| height.abs() <= self.touching) {
            let of_edge = || ends.iter().map(|&end| self.normals[end as usize]).sum::<DVec3>().normalize_or_zero();
            return Some(way * if is_edge { normal } else { of_edge() });
        }
        let point = p + (q - p) * (heights[0] / (heights[0] - heights[1]));
        let beside = |[from, to]: [DVec3; 2]| {
            let outward = (to - from).cross(normal).normalize_or_zero();
            ((from - point).dot(outward) <= self.touching).then(|| {
                let across = (q - p).cross(to - from).normalize_or_zero();
                across * across.dot(outward).signum() * if is_edge { 1.0 } else { -1.0 }
            })
        };
        [[a, b], [b, c], [c, a]].into_iter().find_map(beside)
    }
}
