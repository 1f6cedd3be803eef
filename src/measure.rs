//! Figures of a state, for the caller to judge it by.

use glam::{DVec3, Vec3};

use crate::attributes::Collider;
use crate::model::cloth::Cloth;

/// Figures of the current state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Measure {
    /// Mean over the edges of `max(0, l/l0 - 1)`.
    pub mean_strain: f32,
    /// Maximum over the edges of `max(0, l/l0 - 1)`.
    pub max_strain: f32,
    /// Kinetic energy (J), of the velocities half a substep back (leapfrog).
    pub kinetic_energy: f64,
    /// Potential energy (J): gravity (0 at rest), stretch (none if inextensible) and bending. Below the resolved substep the
    /// stretch that one sweep leaves is counted at the full stiffness, and may be most of it.
    pub potential_energy: f64,
    /// Depth (m) of the deepest vertex in the last step's colliders, 0 if none is inside.
    pub penetration: f32,
}

impl Measure {
    /// Measures the state `x` (m), `v` (m/s), in the cloth's order and local coordinates, in double precision.
    pub(crate) fn new(cloth: &Cloth, bending: f64, x: &[DVec3], v: &[DVec3], gravity: Vec3, colliders: &[Collider]) -> Measure {
        let gravity = gravity.as_dvec3();
        let (mut kinetic, mut potential) = (0.0, 0.0);
        for ((x, v), (rest, &mass)) in x.iter().zip(v).zip(cloth.rest.iter().zip(&cloth.mass)) {
            let mass = f64::from(mass);
            if rest.w > 0.0 {
                kinetic += 0.5 * mass * v.length_squared();
            }
            potential -= mass * gravity.dot(*x - rest.truncate().as_dvec3());
        }
        let (mut sum, mut max) = (0.0, 0.0_f64);
        for link in &cloth.links {
            let [a, b] = link.ends.map(|vertex| x[vertex as usize]);
            let rest = f64::from(link.rest);
            let stretch = a.distance(b) - rest;
            let strain = (stretch / rest).max(0.0);
            sum += strain;
            max = max.max(strain);
            if link.stiffness.is_finite() {
                potential += 0.5 * link.stiffness * stretch * stretch;
            }
        }
        if bending > 0.0 {
            potential += bending * cloth.bending().energy(x);
        }
        let depth = |x: &DVec3| colliders.iter().map(|collider| -collider.depth_from(*x)).fold(0.0, f64::max);
        Measure {
            mean_strain: (sum / cloth.links.len().max(1) as f64) as f32,
            max_strain: max as f32,
            kinetic_energy: kinetic,
            potential_energy: potential,
            penetration: x.iter().map(depth).fold(0.0, f64::max) as f32,
        }
    }
}
