//! Cloth that is pinched between kinematic vertices (of mesh colliders, pins), so that nothing can hold it (Baraff et
//! al. 2003, "Untangling cloth").
//!
//! Truncation cannot shorten the way of a kinematic vertex: where one moves across the plane between the two sides of a
//! pair, the plane moves along, and may pass a vertex that stays in place. Mostly it passes beside what the vertex
//! belongs to, since planes have no borders. But no pair moves through each other unless this happens, and then the
//! volume that its corners span changes its sign. It does move through if its features meet at that moment (Provot 1997,
//! "Collision and self-collision handling in cloth model dedicated to design garments").

use glam::Vec3A;

use super::Contacts;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{Kind, between, closest};
use crate::simd::Vector;

/// Features meet if they come closer than this multiple of the thickness. What is that close before or after does not
/// tell on which side it is.
pub(crate) const COINCIDENT: f32 = 1e-3;
/// Bisections that find the moment at which four points are in a plane.
pub(crate) const BISECTIONS: u32 = 20;

/// A pair whose corners span a volume that has changed its sign in a substep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pinched {
    pub kind: Kind,
    /// By vertices.
    pub corners: [u32; 4],
    /// Whether it has moved through each other.
    pub is_through: bool,
}

impl Contacts {
    /// The pairs that are pinched in this substep, after truncation. Cloth is held apart by the thickness (m).
    pub(crate) fn pinched(&self, thickness: f32) -> Vec<Pinched> {
        let pinched = self.passed().filter_map(|(kind, places)| {
            let (from, to) = (places.map(|place| self.start(place)), places.map(|place| self.end(place)));
            let is_through = moves_through(kind, from, to, thickness)?;
            Some(Pinched { kind, corners: places.map(|place| self.vertices[place as usize].index), is_through })
        });
        pinched.collect()
    }

    /// The pairs whose plane has passed a vertex: their kind and their corners, as places among the vertices of listed pairs.
    pub(crate) fn passed(&self) -> impl Iterator<Item = (Kind, [u32; 4])> {
        self.portions().iter().flat_map(|portion| portion.truncation.passed.iter().map(|&corners| (portion.kind, corners)))
    }

    /// Where a vertex is at the start of the substep (m).
    pub(crate) fn start(&self, place: u32) -> Vec3A {
        xyz(self.vertices[place as usize].x)
    }

    /// Where it is at the end (m).
    pub(crate) fn end(&self, place: u32) -> Vec3A {
        self.start(place) + self.vertices[place as usize].push + xyz(self.u[place as usize])
    }
}

/// Whether the features of a pair meet while its corners move straight from some positions (m) to others; `None` if the volume
/// that the corners span keeps its sign.
pub(crate) fn moves_through(kind: Kind, from: [Vec3A; 4], to: [Vec3A; 4], thickness: f32) -> Option<bool> {
    let before = volume(from);
    if before * volume(to) > 0.0 {
        return None;
    }
    let at = |share: f32| std::array::from_fn(|k| from[k].lerp(to[k], share));
    let [mut early, mut late] = [0.0, 1.0];
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (early + late);
        if before * volume(at(middle)) > 0.0 {
            early = middle;
        } else {
            late = middle;
        }
    }
    let least = COINCIDENT * thickness;
    Some(distance(kind, at(late)) < least && least < distance(kind, from).min(distance(kind, to)))
}

/// The distance (m) between the features of a pair.
pub(crate) fn distance(kind: Kind, corners: [Vec3A; 4]) -> f32 {
    let corners = corners.map(|x| Vector { x: x.x, y: x.y, z: x.z });
    let apart = between(closest(kind, corners), corners);
    apart.dot(apart).sqrt()
}

/// Six times the signed volume (m³) of a tetrahedron.
fn volume(corners: [Vec3A; 4]) -> f32 {
    let [a, b, c, d] = corners;
    (b - a).cross(c - a).dot(d - a)
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_pinches.rs"]
mod tests;
