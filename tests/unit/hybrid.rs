//! Unit tests of `src/hybrid/mod.rs`.

use glam::Vec3;

use crate::{Attributes, Backend, Collider, Deformer, Fabric, Mesh, Options, Quality};

/// The result has the same bits wherever the device reads and writes and whichever part of the state is sent, and it
/// agrees with the CPU.
#[test]
fn memory_in_place_or_copied_gives_the_same_motion() {
    let mesh = Mesh::grid(21, 17, 1.0, 0.8);
    let ball = vec![Collider::sphere(Vec3::new(0.0, -0.2, 0.0), 0.19)];
    for (bending, air_density, colliders) in [(1e-4, 0.0, vec![]), (0.0, 1.2, vec![]), (1e-4, 1.2, ball)] {
        let attributes = Attributes { wind: Vec3::new(3.0, 1.0, 2.0), air_density, colliders, ..Attributes::default() };
        let run = |backend, in_place: Option<[bool; 2]>| {
            let fabric = Fabric { bending, damping: if air_density > 0.0 { 0.05 } else { 0.0 }, ..Fabric::default() };
            let quality = Quality::Substeps(12);
            let options = Options { backend, fabric, quality, pinned: vec![0, 20], ..Options::default() };
            let mut deformer = Deformer::new(&mesh, options).unwrap();
            in_place.into_iter().for_each(|in_place| deformer.exchange_in_place(in_place));
            for _ in 0..5 {
                deformer.step(1.0 / 60.0, &attributes).unwrap();
            }
            deformer.positions().unwrap().to_vec()
        };
        let copied = run(Backend::Hybrid, Some([false; 2]));
        assert!(copied == run(Backend::Hybrid, None));
        let cpu = run(Backend::Cpu, None);
        let rms =
            |a: &[Vec3], b: &[Vec3]| (a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum::<f32>() / a.len() as f32).sqrt();
        let (apart, moved) = (rms(&copied, &cpu), rms(&cpu, &mesh.positions));
        assert!(moved > 0.01 && apart <= 1e-4 * moved, "{apart} m apart of {moved}");
    }
}
