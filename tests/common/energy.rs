//! Conserved quantities, computed in double precision from the mesh's own springs; no figure here comes from the
//! solver.

use cloth_deformer::Mesh;
use cloth_deformer::glam::{DVec3, Vec3};

use super::reference::Spring;

/// The lumped mass (kg) of each vertex: a third of that of each of its triangles.
pub fn masses(mesh: &Mesh, density: f32) -> Vec<f32> {
    let mut masses = vec![0.0; mesh.positions.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        for &v in t {
            masses[v as usize] += density * (b - a).cross(c - a).length() / 6.0;
        }
    }
    masses
}

/// Energy (J) in gravity `g` (m/s²) along -y. Leapfrog velocities are half a substep `h` older than positions, so
/// heights are taken half a substep back too; otherwise the energy of a falling cloth would be off by `m g v h / 2`.
pub fn energy(springs: &[Spring], masses: &[f32], g: f64, h: f64, x: &[Vec3], v: &[Vec3]) -> f64 {
    let x: Vec<DVec3> = x.iter().map(|x| x.as_dvec3()).collect();
    let of_vertex = |((x, v), &m): ((&DVec3, DVec3), &f32)| f64::from(m) * (0.5 * v.length_squared() + g * (x.y - 0.5 * h * v.y));
    let of_spring = |&(i, j, rest, stiffness): &Spring| 0.5 * stiffness * (x[i].distance(x[j]) - rest).powi(2);
    let motion: f64 = x.iter().zip(v.iter().map(|v| v.as_dvec3())).zip(masses).map(of_vertex).sum();
    motion + springs.iter().map(of_spring).sum::<f64>()
}

/// The springs with the stiffness that a sweep at substep `h` (s) gives them: at most `2 / (h² (w_i + w_j))`, since an
/// edge that the substep does not resolve is no stiffer and returns no more energy when released.
pub fn resolved_at(h: f64, springs: &[Spring], masses: &[f32], pinned: &[u32]) -> Vec<Spring> {
    let mut weight: Vec<f64> = masses.iter().map(|&m| 1.0 / f64::from(m)).collect();
    for &v in pinned {
        weight[v as usize] = 0.0;
    }
    let soft = |&(i, j, rest, stiffness): &Spring| (i, j, rest, stiffness.min(2.0 / (h * h * (weight[i] + weight[j]))));
    springs.iter().map(soft).collect()
}

/// Momentum (kg m/s) and angular momentum about the origin (kg m²/s).
pub fn momenta(masses: &[f32], x: &[Vec3], v: &[Vec3]) -> (DVec3, DVec3) {
    let terms = x.iter().zip(v).zip(masses).map(|((x, v), &m)| (x.as_dvec3(), v.as_dvec3() * f64::from(m)));
    terms.fold((DVec3::ZERO, DVec3::ZERO), |(p, l), (x, mv)| (p + mv, l + x.cross(mv)))
}
