//! Intersections of edges with triangles, found in double precision and independently of the lists.

use glam::{DVec3, Vec3, Vec4};

use super::pairs::{Kind, Listed};
use super::surface::Surface;
use crate::options::Crossing;

/// Finds the pairs of an edge and a triangle that intersect at the positions `x` (m) and share no vertex, as indices in
/// sorted order. Only pairs are tested for which `may_meet` accepts a vertex of each.
pub(crate) fn crossings(
    edges: &[[u32; 2]],
    triangles: &[[u32; 3]],
    x: &[Vec4],
    may_meet: impl Fn(u32, u32) -> bool,
) -> Vec<[u32; 2]> {
    let at = |vertex: u32| x[vertex as usize].truncate();
    let (low, high) = triangles.iter().flatten().map(|&v| at(v)).fold((at(0), at(0)), |(low, high), x| (low.min(x), high.max(x)));
    let extent = high - low;
    let axis = if extent.x >= extent.y && extent.x >= extent.z { 0 } else { 1 + usize::from(extent.z > extent.y) };
    // Sweep and prune along the longest axis: a triangle is active for an edge if it begins before the edge ends and
    // ends after it begins.
    let spans = |from: f32, to: f32, index: usize| (from, to, index as u32);
    let mut of_edges: Vec<(f32, f32, u32)> = edges
        .iter()
        .enumerate()
        .map(|(index, ends)| {
            let [a, b] = ends.map(at);
            spans(a.min(b)[axis], a.max(b)[axis], index)
        })
        .collect();
    let mut of_triangles: Vec<(f32, f32, u32)> = triangles
        .iter()
        .enumerate()
        .map(|(index, corners)| {
            let [a, b, c] = corners.map(at);
            spans(a.min(b).min(c)[axis], a.max(b).max(c)[axis], index)
        })
        .collect();
    of_edges.sort_by(|a, b| a.0.total_cmp(&b.0));
    of_triangles.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut active, mut found) = (Vec::<(f32, u32)>::new(), Vec::new());
    let mut next = 0;
    for (from, to, edge) in of_edges {
        while next < of_triangles.len() && of_triangles[next].0 <= to {
            active.push((of_triangles[next].1, of_triangles[next].2));
            next += 1;
        }
        active.retain(|(end, _)| *end >= from);
        let ends = edges[edge as usize];
        let [p, q] = ends.map(at);
        let (low, high) = (p.min(q), p.max(q));
        for &(_, triangle) in &active {
            let corners = triangles[triangle as usize];
            let [a, b, c] = corners.map(at);
            let is_near = a.min(b).min(c).cmple(high).all() && a.max(b).max(c).cmpge(low).all();
            if is_near && may_meet(ends[0], corners[0]) && !ends.iter().any(|end| corners.contains(end)) {
                let double = |v: u32| at(v).as_dvec3();
                if goes_through(ends.map(double), corners.map(double)) {
                    found.push([edge, triangle]);
                }
            }
        }
    }
    found.sort_unstable();
    found
}

/// Whether a segment's ends are on different sides of a triangle's plane, and its line passes all sides of the triangle
/// on the same hand (that is, inside the triangle).
fn goes_through([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let volume = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
    let (above, below) = (volume(a, b, c, p), volume(a, b, c, q));
    let hands = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    (above > 0.0) != (below > 0.0) && (hands.iter().all(|&hand| hand > 0.0) || hands.iter().all(|&hand| hand < 0.0))
}

/// The intersections, and the pairs that contact must ignore so that the cloth can leave an intersection again.
#[derive(Debug, Default)]
pub(super) struct LetGo {
    /// Each an edge and a triangle, sorted.
    pub crossings: Vec<[u32; 2]>,
    /// Ignored pairs of a vertex and a triangle, and of two edges, sorted.
    pairs: [Vec<[u32; 2]>; 2],
}

impl LetGo {
    /// Searches for intersections with bodies and, if `meets_itself`, of the cloth with itself. An edge with an end at
    /// most `touching` (m) from the triangle's plane does not count: see [`super::coincident`].
    pub(super) fn find(&mut self, surface: &Surface, x: &[Vec4], meets_itself: bool, touching: f32) {
        let may_meet = |a: u32, b: u32| surface.may_meet(a, b, meets_itself);
        let mut found = crossings(&surface.edges, &surface.triangles, x, may_meet);
        let at = |vertex: u32| x[vertex as usize].truncate().as_dvec3();
        found.retain(|&[edge, triangle]| {
            let [a, b, c] = surface.triangles[triangle as usize].map(at);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let depth = |end: u32| (at(end) - a).dot(normal).abs();
            surface.edges[edge as usize].iter().all(|&end| depth(end) > f64::from(touching))
        });
        self.take(found, surface);
    }

    /// Whether anything intersects whose vertices are all led (by pins or as parts of bodies). Contact cannot hold
    /// these apart.
    pub(super) fn led_cross(surface: &Surface, x: &[Vec4], meets_itself: bool) -> bool {
        let is_led = |vertices: &[u32]| vertices.iter().all(|&vertex| x[vertex as usize].w == 0.0);
        let of_cloth = |vertices: &[u32]| surface.owner[vertices[0] as usize] == 0 && is_led(vertices);
        // Only the region of led cloth needs a test.
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for &vertex in surface.edges.iter().filter(|ends| of_cloth(*ends)).flatten() {
            let at = x[vertex as usize].truncate();
            (low, high) = (low.min(at), high.max(at));
        }
        // For each vertex a bit for each side of the region that it is beyond. What has all of its vertices beyond the
        // same side is not there.
        let beyond = |at: &Vec4| at.truncate().cmplt(low).bitmask() | at.truncate().cmpgt(high).bitmask() << 3;
        let beyond: Vec<u32> = x.iter().map(beyond).collect();
        let is_beyond = |vertices: &[u32]| vertices.iter().fold(u32::MAX, |all, &vertex| all & beyond[vertex as usize]) != 0;
        let is_there = |vertices: &[u32]| !is_beyond(vertices) && is_led(vertices);
        let edges: Vec<[u32; 2]> = surface.edges.iter().filter(|ends| is_there(*ends)).copied().collect();
        let triangles: Vec<[u32; 3]> = surface.triangles.iter().filter(|corners| is_there(*corners)).copied().collect();
        let may_meet = |a: u32, b: u32| surface.may_meet(a, b, meets_itself);
        !triangles.is_empty() && !crossings(&edges, &triangles, x, may_meet).is_empty()
    }

    /// Replaces the intersections.
    pub(super) fn take(&mut self, crossings: Vec<[u32; 2]>, surface: &Surface) {
        self.crossings = crossings;
        let [with_vertices, with_edges] = &mut self.pairs;
        with_vertices.clear();
        with_edges.clear();
        for &[edge, triangle] in &self.crossings {
            with_vertices.extend(surface.edges[edge as usize].map(|end| [end, triangle]));
            with_edges.extend(surface.sides[triangle as usize].map(|side| [edge.min(side), edge.max(side)]));
        }
        self.pairs.iter_mut().for_each(|pairs| pairs.sort_unstable());
    }

    /// Intersections of the cloth with itself, given by vertices.
    pub(super) fn of_cloth(&self, surface: &Surface) -> impl Iterator<Item = Crossing> {
        let is_own = |[a, b]: [u32; 2]| surface.owner[a as usize] + surface.owner[b as usize] == 0;
        let crossing = |(edge, triangle)| Crossing { edge, triangle };
        self.by_vertices(surface).filter(move |(edge, triangle)| is_own([edge[0], triangle[0]])).map(crossing)
    }

    /// For each intersection of the cloth with a body: the index of the body.
    pub(super) fn with_bodies(&self, surface: &Surface) -> impl Iterator<Item = usize> {
        let owner = |vertex: u32| surface.owner[vertex as usize];
        let owners = self.by_vertices(surface).map(move |(edge, triangle)| owner(edge[0]).max(owner(triangle[0])) as usize);
        owners.filter(|&owner| owner > 0).map(|owner| owner - 1)
    }

    fn by_vertices(&self, surface: &Surface) -> impl Iterator<Item = ([u32; 2], [u32; 3])> {
        let Surface { edges, triangles, .. } = surface;
        self.crossings.iter().map(|&[edge, triangle]| (edges[edge as usize], triangles[triangle as usize]))
    }

    #[cfg(feature = "gpu")]
    pub(super) fn pairs(&self) -> &[Vec<[u32; 2]>; 2] {
        &self.pairs
    }

    /// Whether a pair is ignored.
    pub(super) fn has(&self, kind: Kind, first: u32, pair: &Listed) -> bool {
        let pairs = &self.pairs[kind as usize];
        !pairs.is_empty() && pairs.binary_search(&[first, pair.other]).is_ok()
    }
}
