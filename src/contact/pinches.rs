//! Cloth that is pinched between what is led from outside (mesh colliders, pins), so that nothing can hold it (Baraff et
//! al. 2003, "Untangling cloth").
//!
//! Truncation cannot shorten what is led: where one side of a pair is led across the plane between the two, the plane moves
//! along, and may pass a vertex that stays in place. Mostly it passes beside what the vertex belongs to, since planes have
//! no borders. But no pair moves through each other unless this happens, and then the volume that its corners span changes
//! its sign.

use glam::Vec3A;

use super::contacts::Contacts;
use crate::kernels::integrate::xyz;

impl Contacts {
    /// The corners of pairs that may have moved through each other in this substep, after truncation.
    pub(super) fn pinched(&self) -> Vec<u32> {
        let passed = self.portions().iter().flat_map(|portion| &portion.passed);
        let start = |place: u32| xyz(self.vertices[place as usize].x);
        let end = |place: u32| start(place) + self.vertices[place as usize].push + xyz(self.u[place as usize]);
        let pinched = passed.filter(|corners| volume(corners.map(start)) * volume(corners.map(end)) <= 0.0);
        pinched.flatten().map(|&place| self.vertices[place as usize].index).collect()
    }
}

/// Six times the signed volume (m³) of a tetrahedron.
fn volume(corners: [Vec3A; 4]) -> f64 {
    let [a, b, c, d] = corners.map(Vec3A::as_dvec3);
    (b - a).cross(c - a).dot(d - a)
}
