//! Cloth that is pinched between what is led from outside (mesh colliders, pins), so that nothing can hold it (Baraff et
//! al. 2003, "Untangling cloth").
//!
//! Truncation cannot shorten what is led: where one side of a pair is led across the plane between the two, the plane moves
//! along, and may pass a vertex that stays in place. Mostly it passes beside what the vertex belongs to, since planes have
//! no borders. But no pair moves through each other unless this happens, and then the volume that its corners span changes
//! its sign.

use glam::Vec4;

use super::contacts::Contacts;

impl Contacts {
    /// The corners of pairs that may have moved through each other in the substep that begins at positions `x` (m) and
    /// has the displacements `u` (m).
    pub(super) fn pinched(&self, x: &[Vec4], u: &[Vec4]) -> Vec<u32> {
        let passed = self.portions().iter().flat_map(|portion| &portion.passed);
        let corners = passed.map(|corners| corners.map(|place| self.vertices[place as usize].index));
        let start = |vertex: u32| x[vertex as usize];
        let end = |vertex: u32| x[vertex as usize] + u[vertex as usize];
        corners.filter(|&corners| volume(corners.map(start)) * volume(corners.map(end)) <= 0.0).flatten().collect()
    }
}

/// Six times the signed volume (m³) of a tetrahedron.
fn volume(corners: [Vec4; 4]) -> f64 {
    let [a, b, c, d] = corners.map(|corner| corner.truncate().as_dvec3());
    (b - a).cross(c - a).dot(d - a)
}
