//! Conserved quantities, in double precision, with the mesh's own springs: no figure here comes from the solver.

use cloth_deformer::glam::{DVec3, Vec3};

use super::reference::Spring;

/// Energy [J] in gravity `g` [m/s²] along -y. Velocities are half a substep `h` back (leapfrog), so the positions are
/// taken back by as much: without that, the energy of a falling cloth is off by `m g v h / 2`.
pub fn energy(springs: &[Spring], masses: &[f32], g: f64, h: f64, x: &[Vec3], v: &[Vec3]) -> f64 {
    let x: Vec<DVec3> = x.iter().zip(v).map(|(x, v)| x.as_dvec3() - v.as_dvec3() * (0.5 * h)).collect();
    let of_vertex = |((x, v), &m): ((&DVec3, &Vec3), &f32)| f64::from(m) * (0.5 * v.as_dvec3().length_squared() + g * x.y);
    let of_spring = |&(i, j, rest, stiffness): &Spring| 0.5 * stiffness * (x[i].distance(x[j]) - rest).powi(2);
    x.iter().zip(v).zip(masses).map(of_vertex).sum::<f64>() + springs.iter().map(of_spring).sum::<f64>()
}

/// Momentum [kg m/s] and angular momentum about the origin [kg m²/s].
pub fn momenta(masses: &[f32], x: &[Vec3], v: &[Vec3]) -> (DVec3, DVec3) {
    let terms = x.iter().zip(v).zip(masses).map(|((x, v), &m)| (x.as_dvec3(), v.as_dvec3() * f64::from(m)));
    terms.fold((DVec3::ZERO, DVec3::ZERO), |(p, l), (x, mv)| (p + mv, l + x.cross(mv)))
}
