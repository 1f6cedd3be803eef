//! Figures of a state, for the caller to judge it by.

use glam::{DVec3, Vec3};

use crate::attributes::Collider;
use crate::kernels::statistics::{StrainGauge, WHOLE};
use crate::model::cloth::Cloth;
use crate::options::Quality;

/// Figures of the current state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Measure {
    /// Mean over the edges of `max(0, l/l0 - 1)`.
    pub mean_strain: f32,
    /// Maximum over the edges of `max(0, l/l0 - 1)`.
    pub max_strain: f32,
    /// What 99 per cent of the cloth's area does not exceed of `max(0, l/l0 - 1)`, each edge counted with the area of its triangles; edges
    /// that [`Options::edge_scale`](crate::Options::edge_scale) softens below a half are left out.
    pub stretch_share: f32,
    /// Kinetic energy (J), of the velocities half a substep back (leapfrog).
    pub kinetic_energy: f64,
    /// Potential energy (J): gravity (0 at rest), stretch (none if inextensible) and bending. Below the resolved substep the
    /// stretch that one sweep leaves is counted at the full stiffness, and may be most of it.
    pub potential_energy: f64,
    /// Depth (m) of the deepest vertex in the last step's colliders, 0 if none is inside; meshes have no inside.
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
            stretch_share: stretch_share(cloth, x) as f32,
            kinetic_energy: kinetic,
            potential_energy: potential,
            penetration: x.iter().map(depth).fold(0.0, f64::max) as f32,
        }
    }
}

/// The stretch that 99 per cent of the area does not exceed.
fn stretch_share(cloth: &Cloth, x: &[DVec3]) -> f64 {
    let stretch = |gauge: &StrainGauge| {
        let [a, b] = gauge.ends.map(|vertex| x[vertex as usize]);
        ((a.distance(b) * f64::from(gauge.inverse_rest) - 1.0).max(0.0), gauge.weight)
    };
    let mut stretches: Vec<(f64, u32)> = cloth.gauges().iter().map(stretch).collect();
    stretches.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let mut left = (1.0 - f64::from(Quality::MOST_OF_THE_AREA)) * f64::from(WHOLE);
    let exceeds = |(_, weight): &&(f64, u32)| {
        left -= f64::from(*weight);
        left < 0.0
    };
    stretches.iter().find(exceeds).map_or(0.0, |(stretch, _)| *stretch)
}
