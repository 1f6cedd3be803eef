//! Intersections of edges with triangles, found in double precision and independently of the lists.
//!
//! # Exact touches
//! Vertices in triangles, edges through edges and surfaces in one plane are what people model. So that each edge
//! definitely passes through a triangle or not, the search moves each vertex by a tiny vector of its own (as the
//! simulation of simplicity by Edelsbrunner and Mücke 1990 does in symbols; double precision has bits to spare for
//! positions in single precision). What this makes intersect merely touches if moves of about [`Features::touching`] undo
//! it: see [`touches`].

mod apart;
pub(super) mod contours;
pub(super) mod known;
pub(super) mod overlaps;
mod touches;

use glam::{DVec3, Vec4};

use super::crossings::overlaps::{box_around, overlaps};

/// Distances below this multiple of the thickness count as zero.
const TOUCH_SHARE: f64 = 1e-4;
/// The vectors by which vertices are moved, relative to the largest coordinate: against the normal, and at random.
const OFFSET: f64 = 1.0 / (1_u64 << 36) as f64;
const NOISE: f64 = OFFSET / 64.0;
/// The rounding of positions in single precision, relative to the largest coordinate: eight units in the last place.
const ROUNDING: f64 = 1.0 / (1_u64 << 21) as f64;

/// Edges and triangles that may intersect.
#[derive(Clone, Copy)]
pub(crate) struct Features<'a> {
    pub edges: &'a [[u32; 2]],
    pub triangles: &'a [[u32; 3]],
    /// The positions (m) of the vertices. Those of mesh colliders follow the cloth's, from index `cloth_vertices` on.
    pub x: &'a [Vec4],
    pub cloth_vertices: usize,
    /// The thickness (m) of the cloth.
    pub thickness: f32,
    /// Whether the cloth may intersect itself, or only bodies.
    pub has_self_contact: bool,
    /// Whether the pool's threads share a search. Not where they step other cloths.
    pub is_shared: bool,
}

impl Features<'_> {
    /// Whether an edge and a triangle may intersect: of the cloth and a body, or of the cloth with itself, without a common vertex.
    fn may_cross(&self, ends: [u32; 2], corners: [u32; 3]) -> bool {
        self.may_collide(ends[0], corners[0]) && !ends.iter().any(|end| corners.contains(end))
    }

    /// Whether the owners of two vertices can touch: the cloth and a body, or the cloth and itself.
    fn may_collide(&self, a: u32, b: u32) -> bool {
        match [a, b].map(|vertex| (vertex as usize) < self.cloth_vertices) {
            [true, true] => self.has_self_contact,
            [a, b] => a || b,
        }
    }

    /// The distance (m) below which features touch: a small share of the thickness, or what rounding may be, which is that of the
    /// cloth. A mesh collider may be as large as a landscape.
    pub(crate) fn touching(&self) -> f64 {
        let of_cloth = self.extent(|vertex| (vertex as usize) < self.cloth_vertices);
        self.share_of_thickness().max(ROUNDING * of_cloth)
    }

    /// The distance (m) below which features touch where rounding is no matter.
    fn share_of_thickness(&self) -> f64 {
        TOUCH_SHARE * f64::from(self.thickness)
    }

    /// The largest coordinate (m) of a corner of any triangle whose vertices count.
    fn extent(&self, counts: impl Fn(u32) -> bool) -> f64 {
        let largest = |all: f32, &vertex: &u32| all.max(self.x[vertex as usize].truncate().abs().max_element());
        f64::from(self.triangles.iter().flatten().filter(|&&vertex| counts(vertex)).fold(0.0, largest))
    }

    /// Whether boxes around an edge and a triangle that may meet overlap or touch. Where none do, nothing intersects.
    pub(crate) fn are_close(&self) -> bool {
        let (at, touching) = (|vertex: u32| self.x[vertex as usize].truncate().as_dvec3(), self.touching());
        let of_edges: Vec<_> = self.edges.iter().map(|ends| box_around(&ends.map(at), touching)).collect();
        let of_triangles: Vec<_> = self.triangles.iter().map(|corners| box_around(&corners.map(at), touching)).collect();
        let close = overlaps(&of_edges, &of_triangles, &mut { usize::MAX }, self.is_shared, &|edge, triangle| {
            self.may_cross(self.edges[edge], self.triangles[triangle])
        });
        !close.is_empty()
    }

    /// Positions (m) at which no four vertices are in one plane, and the normals of the vertices.
    ///
    /// Everything moves against its normal, mesh colliders the most and the first vertices more than the last. So two
    /// layers in one plane are in front of each other if they face each other, cloth is in front of a mesh collider, and
    /// of two layers that face the same way the one with the higher indices is in front.
    pub(crate) fn in_general_position(&self) -> (Vec<DVec3>, Vec<DVec3>) {
        let mut x: Vec<DVec3> = self.x.iter().map(|x| x.truncate().as_dvec3()).collect();
        let mut normals = vec![DVec3::ZERO; x.len()];
        for corners in self.triangles {
            let [a, b, c] = corners.map(|vertex| x[vertex as usize]);
            corners.iter().for_each(|&vertex| normals[vertex as usize] += (b - a).cross(c - a));
        }
        let (extent, count) = (self.extent(|_| true), self.cloth_vertices.max(1) as f64);
        for (vertex, (x, normal)) in x.iter_mut().zip(&mut normals).enumerate() {
            *normal = normal.normalize_or_zero();
            let share = if vertex < self.cloth_vertices { 2.0 - vertex as f64 / count } else { 3.0 };
            let random = DVec3::from_array([0, 1, 2].map(|axis| random(3 * vertex as u32 + axis)));
            *x += extent * (NOISE * random - OFFSET * share * *normal);
        }
        (x, normals)
    }

    /// The pairs of an edge and a triangle that intersect at the positions `x` (m), as indices in sorted order. Stops once `room` for
    /// pairs of overlapping boxes is used up.
    pub(crate) fn pierced(&self, x: &[DVec3], room: &mut usize) -> Vec<[u32; 2]> {
        let at = |vertex: u32| x[vertex as usize];
        let of_edges: Vec<_> = self.edges.iter().map(|ends| box_around(&ends.map(at), 0.0)).collect();
        let of_triangles: Vec<_> = self.triangles.iter().map(|corners| box_around(&corners.map(at), 0.0)).collect();
        let mut found = overlaps(&of_edges, &of_triangles, room, self.is_shared, &|edge, triangle| {
            let (ends, corners) = (self.edges[edge], self.triangles[triangle]);
            self.may_cross(ends, corners) && goes_through(ends.map(at), corners.map(at))
        });
        found.sort_unstable();
        found
    }
}

/// A number from -1 to 1 that is determined by another in no simple way (the last steps of Appleby's `MurmurHash3`).
fn random(mut number: u32) -> f64 {
    number = (number ^ number >> 16).wrapping_add(0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    number = (number ^ number >> 13).wrapping_mul(0xc2b2_ae35);
    f64::from((number ^ number >> 16) as i32) / f64::from(1_u32 << 31)
}

/// Whether a segment's ends are on different sides of a triangle's plane, and its line passes all sides of the triangle
/// on the same hand (that is, inside the triangle).
fn goes_through([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let volume = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
    let (above, below) = (volume(a, b, c, p), volume(a, b, c, q));
    let hands = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    (above > 0.0) != (below > 0.0) && (hands.iter().all(|&hand| hand > 0.0) || hands.iter().all(|&hand| hand < 0.0))
}
