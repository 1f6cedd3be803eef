//! The mean motion of free cloth, and the momentum that truncation takes from it.

use glam::{DVec3, Vec3A, Vec4};

use super::VERTICES_OF_PART;
use super::bodies::Bodies;
use super::workers::Workers;
use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::step::plan::Plan;

/// The mean displacement (m), weighted by mass.
pub(super) fn mean(cloth: &Cloth, u: &[Vec4]) -> Vec3A {
    let (mut sum, mut total) = (Vec3A::ZERO, 0.0);
    for (&u, mass) in u.iter().zip(free_masses(cloth)) {
        sum += xyz(u) * mass;
        total += mass;
    }
    sum / total
}

/// The mass (kg) of each vertex; 0 if it is not free.
fn free_masses(cloth: &Cloth) -> impl Iterator<Item = f32> {
    cloth.mass.iter().zip(&cloth.rest).map(|(&mass, rest)| if rest.w > 0.0 { mass } else { 0.0 })
}

/// Whether momentum that truncation removes is returned to the cloth as a whole. Not if it has kinematic vertices, or mesh colliders
/// that it [may meet](Bodies::may_meet), because it must not move relative to them. Other colliders stop it in the next substep if it
/// touches them, but not those of its parts that are elsewhere.
pub(crate) fn returns_momentum(plan: &Plan<'_>, bodies: &Bodies) -> bool {
    !plan.cloth.has_pins() && !bodies.may_meet && (plan.bodies.is_empty() || plan.cloth.extents.parts == 1)
}

/// Returns lost momentum (kg m) to the cloth by a uniform displacement.
pub(super) fn give_back(cloth: &Cloth, lost: DVec3, u: &mut [Vec4], workers: Workers<'_>) {
    let mass: f64 = free_masses(cloth).map(f64::from).sum();
    let back = (lost / mass).as_vec3().extend(0.0);
    workers.chunks(&mut u[..cloth.rest.len()], VERTICES_OF_PART, |first, u| {
        u.iter_mut().zip(&cloth.rest[first..]).filter(|(_, rest)| rest.w > 0.0).for_each(|(u, _)| *u += back);
    });
}
