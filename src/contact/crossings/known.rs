//! The known intersections, and the pairs that contact ignores because of them.

use glam::{Vec3, Vec4};

use super::Features;
use super::apart::apart;
use crate::contact::contacts::pinches::Pinched;
use crate::contact::surface::Surface;
use crate::contact::surface::pairs::{Listed, crossing_of};
use crate::kernels::pair::Kind;
use crate::model::csr::distinct;
use crate::model::mesh::bounds;
use crate::options::Crossing;

/// The rings of triangles around known intersections in which others are searched for, for which one would suffice, and in which
/// nothing is carried.
const RINGS: usize = 2;
/// From one in so many vertices on, a search around them takes as long as one of everything.
const MANY: usize = 16;

/// A surface with all vertices at some positions (m), and whether the pool's threads share searches on it.
#[derive(Clone, Copy)]
pub(crate) struct Posed<'a> {
    pub surface: &'a Surface,
    pub x: &'a [Vec4],
    pub is_shared: bool,
}

/// The known intersections, and the pairs that contact must ignore so that the cloth can leave an intersection again.
#[derive(Debug, Default)]
pub(crate) struct KnownCrossings {
    /// Each an edge and a triangle, sorted.
    pub pairs: Vec<[u32; 2]>,
    /// Whether there were no others when they were last searched for. Since then, others arise only around these, where cloth is
    /// pinched, and around vertices that `drifted`: contact led them off their paths in this step.
    pub are_all: bool,
    pub drifted: Vec<u32>,
    /// Whether vertices drifted in this step so that something may have got through, where nothing crossed before.
    may_have_arisen: bool,
    /// Pairs of an edge and a triangle that have moved through each other in this step, sorted. They need not intersect any more.
    through: Vec<[u32; 2]>,
    /// Ignored pairs of a vertex and a triangle, and of two edges, sorted.
    pub ignored: [Vec<[u32; 2]>; 2],
    /// The vertices around known intersections, sorted. They are not carried, since what crosses would not separate then.
    pub entangled: Vec<u32>,
}

impl KnownCrossings {
    /// Searches for all intersections: of the cloth with bodies and, if it has contact with itself, of the cloth with itself.
    /// Of cloth that is crammed into one place none is known; detection refuses it.
    pub(crate) fn find(&mut self, posed: Posed<'_>) {
        let found = posed.features().crossings();
        self.take(found.unwrap_or_default(), posed.surface);
        self.are_all = true;
    }

    /// Searches where there may be others: everywhere, or around the known ones and some vertices. Returns whether they may have changed.
    pub(crate) fn search(&mut self, posed: Posed<'_>, vertices: &[u32]) -> bool {
        let anywhere = !self.look_around(posed);
        if anywhere {
            self.find(posed);
        }
        anywhere || self.follow(posed, vertices)
    }

    /// Looks around the vertices that drifted. Returns whether the known intersections are all that there are.
    pub(crate) fn look_around(&mut self, posed: Posed<'_>) -> bool {
        let drifted = std::mem::take(&mut self.drifted);
        if self.are_all && KnownCrossings::cross_around(posed, drifted) {
            self.are_all = false;
            self.may_have_arisen |= self.pairs.is_empty() && self.through.is_empty();
        }
        self.are_all
    }

    /// Searches for intersections around the known ones and around some vertices only. Returns whether there are others than
    /// before.
    ///
    /// While contact holds all other pairs, intersections arise only where pairs are ignored, or pinched: a vertex that moves
    /// through a triangle takes its edges along, and an edge that moves past a side of a triangle gets into its neighbor.
    pub(crate) fn follow(&mut self, posed: Posed<'_>, vertices: &[u32]) -> bool {
        let surface = posed.surface;
        if self.pairs.is_empty() && vertices.is_empty() {
            return false;
        }
        let known = self.pairs.iter().flat_map(|&pair| corners(pair, surface));
        let [_, triangles] = neighborhood(surface, known.chain(vertices.iter().copied()).collect());
        let edges = sides(surface, &triangles);
        let features = Features {
            edges: &edges.iter().map(|&edge| surface.edges[edge as usize]).collect::<Vec<_>>(),
            triangles: &triangles.iter().map(|&triangle| surface.triangles[triangle as usize]).collect::<Vec<_>>(),
            ..posed.features()
        };
        let found = features.crossings().unwrap_or_default();
        let found: Vec<[u32; 2]> =
            found.iter().map(|&[edge, triangle]| [edges[edge as usize], triangles[triangle as usize]]).collect();
        let are_new = found != self.pairs;
        if are_new {
            self.take(found, surface);
        }
        are_new
    }

    /// Whether anything intersects, if that is only possible around some vertices, or anywhere.
    #[cfg(feature = "gpu")]
    pub(crate) fn cross(posed: Posed<'_>, vertices: Option<&[u32]>) -> bool {
        vertices.is_none_or(|vertices| KnownCrossings::cross_around(posed, vertices.to_vec()))
            && posed.features().crossings().is_ok_and(|found| !found.is_empty())
    }

    /// Whether anything intersects the features at some vertices of the cloth, or merely touches them. If these are many, it is not
    /// found out.
    fn cross_around(posed: Posed<'_>, vertices: Vec<u32>) -> bool {
        let (surface, vertices) = (posed.surface, distinct(vertices));
        if vertices.is_empty() || MANY * vertices.len() > surface.cloth_vertices() {
            return !vertices.is_empty();
        }
        let triangles = triangles_around(surface, &vertices);
        let edges = sides(surface, &triangles);
        let triangles: Vec<[u32; 3]> = triangles.into_iter().map(|triangle| surface.triangles[triangle as usize]).collect();
        let edges: Vec<[u32; 2]> = edges.into_iter().map(|edge| surface.edges[edge as usize]).collect();
        let (x, _) = posed.features().in_general_position();
        let [of_edges, of_triangles] = [(&edges, &surface.triangles), (&surface.edges, &triangles)]
            .map(|(edges, triangles)| Features { edges, triangles, ..posed.features() }.pierced(&x, &mut { usize::MAX }));
        !(of_edges.is_empty() && of_triangles.is_empty())
    }

    /// Whether intersections arose in this step around vertices that drifted, where there were none before.
    pub(crate) fn have_arisen(&self) -> bool {
        self.may_have_arisen && !self.pairs.is_empty()
    }

    /// Begins a step.
    pub(crate) fn begin(&mut self) {
        self.through.clear();
        self.drifted.clear();
        self.may_have_arisen = false;
    }

    /// Notes which of the pinched pairs have moved through each other.
    pub(crate) fn note(&mut self, pinched: &[Pinched], surface: &Surface) {
        let through = pinched.iter().filter(|pair| pair.is_through);
        self.through.extend(through.filter_map(|pair| crossing_of(surface, pair.kind, pair.corners)));
        // A feature that moves through another one has several pairs, in several substeps.
        self.through.sort_unstable();
        self.through.dedup();
    }

    /// Moves apart what touches exactly. Returns the vertices that move, with their new positions (m).
    pub(crate) fn part_touches(posed: Posed<'_>) -> Vec<(u32, Vec4)> {
        apart(posed.features())
    }

    /// Whether anything intersects whose vertices are all kinematic (pins or parts of bodies). Contact cannot hold
    /// these apart.
    pub(crate) fn kinematics_cross(posed: Posed<'_>) -> bool {
        let Posed { surface, x, .. } = posed;
        let (mut edges, mut triangles) = kinematic_features(surface, x);
        if edges.is_empty() {
            return false;
        }
        // Only what is around the kinematic cloth can intersect it, and edges of bodies only if they meet its triangles.
        let region = bounds(edges.iter().flatten().map(|&vertex| x[vertex as usize].truncate()));
        let (body_edges, body_triangles) = bodies_within(surface, x, region, !triangles.is_empty());
        edges.extend(body_edges);
        triangles.extend(body_triangles);
        let features = Features { edges: &edges, triangles: &triangles, ..posed.features() };
        features.are_close() && !features.crossings().is_ok_and(|found| found.is_empty())
    }

    /// Replaces the intersections.
    pub(crate) fn take(&mut self, crossings: Vec<[u32; 2]>, surface: &Surface) {
        self.pairs = crossings;
        let [with_vertices, with_edges] = &mut self.ignored;
        with_vertices.clear();
        with_edges.clear();
        for &[edge, triangle] in &self.pairs {
            with_vertices.extend(surface.edges[edge as usize].map(|end| [end, triangle]));
            with_edges.extend(surface.sides[triangle as usize].map(|side| [edge.min(side), edge.max(side)]));
        }
        self.ignored.iter_mut().for_each(|pairs| pairs.sort_unstable());
        let [near, _] = neighborhood(surface, self.pairs.iter().flat_map(|&pair| corners(pair, surface)).collect());
        self.entangled = near;
    }

    /// What intersects, or did in this step: of the cloth with itself, given by vertices, and for each pair of the cloth and a body
    /// the index of the body.
    pub(crate) fn all(&self, surface: &Surface) -> (Vec<Crossing>, Vec<usize>) {
        let (mut own, mut with_bodies) = (Vec::new(), Vec::new());
        let through = self.through.iter().filter(|pair| self.pairs.binary_search(pair).is_err());
        for (edge, triangle) in self.pairs.iter().chain(through).map(|&pair| by_vertices(pair, surface)) {
            match surface.owner[edge[0] as usize].max(surface.owner[triangle[0] as usize]) {
                0 => own.push(Crossing { edge, triangle }),
                owner => with_bodies.push(owner as usize - 1),
            }
        }
        (own, with_bodies)
    }

    /// Whether a pair is ignored.
    pub(crate) fn ignores(&self, kind: Kind, first: u32, pair: &Listed) -> bool {
        let pairs = &self.ignored[kind as usize];
        !pairs.is_empty() && pairs.binary_search(&[first, pair.other]).is_ok()
    }
}

/// The edges and triangles of the cloth whose vertices are all kinematic, given by vertices.
fn kinematic_features(surface: &Surface, x: &[Vec4]) -> (Vec<[u32; 2]>, Vec<[u32; 3]>) {
    let is_kinematic = |vertices: &[u32]| vertices.iter().all(|&vertex| x[vertex as usize].w == 0.0);
    // They are all around the pins, which are few.
    let pins = (0..surface.cloth_vertices().min(x.len()) as u32).filter(|vertex| is_kinematic(&[*vertex]));
    let mut triangles: Vec<u32> = pins.flat_map(|vertex| surface.at.of(vertex)).copied().collect();
    let mut edges: Vec<u32> = triangles.iter().flat_map(|&triangle| surface.sides[triangle as usize]).collect();
    edges.retain(|&edge| is_kinematic(&surface.edges[edge as usize]));
    triangles.retain(|&triangle| is_kinematic(&surface.triangles[triangle as usize]));
    let edges = distinct(edges).into_iter().map(|edge| surface.edges[edge as usize]);
    let triangles = distinct(triangles).into_iter().map(|triangle| surface.triangles[triangle as usize]);
    (edges.collect(), triangles.collect())
}

/// The edges (if `with_edges`) and triangles of bodies that may reach into a box, given by vertices.
fn bodies_within(surface: &Surface, x: &[Vec4], [low, high]: [Vec3; 2], with_edges: bool) -> (Vec<[u32; 2]>, Vec<[u32; 3]>) {
    let cloth = surface.cloth_vertices();
    // For each vertex a bit for each side of the box that it is beyond. A feature with all of its vertices beyond the same side
    // does not reach into the box.
    let beyond = |at: &Vec4| at.truncate().cmplt(low).bitmask() | at.truncate().cmpgt(high).bitmask() << 3;
    let beyond: Vec<u32> = x.get(cloth..).unwrap_or_default().iter().map(beyond).collect();
    let may_reach = |vertices: &[u32]| vertices.iter().fold(u32::MAX, |all, &vertex| all & beyond[vertex as usize - cloth]) == 0;
    let is_of_cloth = |vertices: &[u32]| surface.owner[vertices[0] as usize] == 0;
    let edges = &surface.edges[surface.edges.partition_point(|ends| is_of_cloth(ends))..];
    let edges = edges.iter().filter(|ends| with_edges && may_reach(*ends)).copied();
    let triangles = &surface.triangles[surface.cloth_triangles()..];
    let triangles = triangles.iter().filter(|corners| may_reach(*corners)).copied();
    (edges.collect(), triangles.collect())
}

/// The vertices and triangles in some rings around vertices.
fn neighborhood(surface: &Surface, mut vertices: Vec<u32>) -> [Vec<u32>; 2] {
    let mut triangles = Vec::new();
    for _ in 0..RINGS {
        triangles = triangles_around(surface, &vertices);
        vertices = distinct(triangles.iter().flat_map(|&triangle| surface.triangles[triangle as usize]).collect());
    }
    [vertices, triangles]
}

/// The triangles at some vertices of the cloth.
fn triangles_around(surface: &Surface, vertices: &[u32]) -> Vec<u32> {
    distinct(vertices.iter().flat_map(|&vertex| surface.at.of(vertex)).copied().collect())
}

/// The edges of some triangles.
fn sides(surface: &Surface, triangles: &[u32]) -> Vec<u32> {
    distinct(triangles.iter().flat_map(|&triangle| surface.sides[triangle as usize]).collect())
}

/// The vertices of an intersection.
fn corners(crossing: [u32; 2], surface: &Surface) -> [u32; 5] {
    let ([a, b], [c, d, e]) = by_vertices(crossing, surface);
    [a, b, c, d, e]
}

/// The vertices of an edge and of a triangle.
fn by_vertices([edge, triangle]: [u32; 2], surface: &Surface) -> ([u32; 2], [u32; 3]) {
    (surface.edges[edge as usize], surface.triangles[triangle as usize])
}

impl<'a> Posed<'a> {
    fn features(self) -> Features<'a> {
        let Posed { surface, x, is_shared } = self;
        let Surface { edges, triangles, thickness, .. } = surface;
        let (cloth_vertices, has_self_contact) = (surface.cloth_vertices(), surface.has_self_contact);
        Features { edges, triangles, x, cloth_vertices, thickness: *thickness, has_self_contact, is_shared }
    }
}
