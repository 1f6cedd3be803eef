//! Strain, energy and penetration of a state.

use glam::{DVec3, Vec3};

use crate::attributes::Collider;
use crate::kernels::statistics::{StrainGauge, WHOLE};
use crate::model::cloth::Cloth;
use crate::options::Quality;

/// Strain, energy and penetration of the current state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Measure {
    /// Mean over the edges of `max(0, l/l0 - 1)`, where edges without length at rest count as not stretched.
    pub mean_strain: f32,
    /// Maximum over the edges of `max(0, l/l0 - 1)`.
    pub max_strain: f32,
    /// The stretch `max(0, l/l0 - 1)` that 99 percent of the cloth's area does not exceed, each edge weighted by the
    /// area of its triangles. Edges that [`Options::edge_scale`](crate::Options::edge_scale) makes softer than half of
    /// the fabric, or of the stiffest edge if none is stiffer, are left out.
    pub stretch_share: f32,
    /// Kinetic energy (J). Velocities are those of half a substep ago (leapfrog).
    pub kinetic_energy: f64,
    /// Potential energy (J) of gravity (0 at rest), stretch (0 if inextensible) and bending. With substeps that do not
    /// resolve the stiffness, the stretch that one sweep leaves is counted at the full stiffness, and may be most of
    /// the sum.
    pub potential_energy: f64,
    /// Depth (m) of the deepest vertex inside the last step's colliders, 0 if none is inside. Mesh colliders have no
    /// inside.
    pub penetration: f32,
}

impl Measure {
    /// Measures, in double precision, the state `x` (m) and `v` (m/s), given in the cloth's order and local
    /// coordinates.
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
            if cloth.has_length(link) {
                let strain = (stretch / rest).max(0.0);
                sum += strain;
                max = max.max(strain);
            }
            let stiffness = cloth.stiffness(link);
            if stiffness.is_finite() {
                potential += 0.5 * stiffness * stretch * stretch;
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
            penetration: x[..cloth.used].iter().map(depth).fold(0.0, f64::max) as f32,
        }
    }
}

/// The stretch that 99 percent of the area does not exceed.
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
