//! Which meshes have an inside.

use std::f32::consts::TAU;

use glam::Vec3;

use super::is_closed;
use crate::model::mesh::Mesh;

/// A sphere (radius .37 m) as modelers write it: the vertices of the meridian at which it begins exist twice, at `from` and, rounded
/// differently, at `from + 2 pi`.
fn sphere_with_seam(from: f32) -> Mesh {
    const RINGS: u32 = 24;
    const STEPS: u32 = 48;
    let at = |ring: u32, step: u32| {
        let (polar, angle) = (ring as f32 / RINGS as f32 * TAU / 2.0, from + step as f32 / STEPS as f32 * TAU);
        0.37 * Vec3::new(polar.sin() * angle.cos(), polar.cos(), polar.sin() * angle.sin())
    };
    let positions = (0..=RINGS).flat_map(|ring| (0..=STEPS).map(move |step| at(ring, step))).collect();
    let quad = |ring: u32, step: u32| {
        let a = ring * (STEPS + 1) + step;
        let b = a + STEPS + 1;
        [[a, a + 1, b], [b, a + 1, b + 1]]
    };
    let triangles = (0..RINGS).flat_map(|ring| (0..STEPS).flat_map(move |step| quad(ring, step))).collect();
    Mesh { positions, triangles }
}

#[test]
fn a_seam_that_is_rounded_differently_is_closed() {
    for k in 0..200 {
        let mut sphere = sphere_with_seam(0.01 * k as f32);
        assert!(is_closed(&sphere), "from {}", 0.01 * k as f32);
        sphere.triangles.remove(500);
        assert!(!is_closed(&sphere), "without a triangle");
    }
}

#[test]
fn what_is_apart_is_not_joined() {
    let mut sphere = sphere_with_seam(0.3);
    // A gap of 0.17 mm, where 7 um count as none.
    sphere.positions.iter_mut().step_by(49).for_each(|x| *x += 1e-4 * Vec3::ONE);
    assert!(!is_closed(&sphere));
}
