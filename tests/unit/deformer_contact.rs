//! Unit tests of `src/deformer/contact.rs`.

use std::sync::Arc;

use glam::Vec3;

use super::*;
use crate::attributes::Collider;
use crate::model::mesh::Mesh;
use crate::options::Options;

/// A cloth that the library put on the GPU goes on on the CPU as soon as a mesh collider appears, from where it was; one that was put there by
/// name is refused the collider, and stays.
#[test]
fn a_mesh_collider_moves_the_cloth_to_the_cpu() {
    let mesh = Mesh::grid(20, 20, 1.0, 1.0);
    let options = |backend| Options { backend, pinned: vec![0, 19], quality: Quality::Substeps(20), ..Options::default() };
    let mut on_cpu = Deformer::new(&mesh, options(Backend::Cpu)).unwrap();
    let mut cloth = Deformer::new(&mesh, options(Backend::Gpu)).unwrap();
    let mut play = |cloth: &mut Deformer, frames: u32, attributes: &Attributes| {
        for _ in 0..frames {
            cloth.step(1.0 / 60.0, attributes).unwrap();
            on_cpu.step(1.0 / 60.0, attributes).unwrap();
        }
        let x = on_cpu.positions().unwrap();
        cloth.positions().unwrap().iter().zip(x).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
    };
    let air = Attributes::default();
    assert!(play(&mut cloth, 5, &air) < 1e-4);

    let mut table = Mesh::grid(3, 3, 3.0, 3.0);
    table.positions.iter_mut().for_each(|x| x.y = -0.3);
    let with_table = Attributes { colliders: vec![Collider::mesh(Arc::new(table))], ..Attributes::default() };
    let error = cloth.step(1.0 / 60.0, &with_table).unwrap_err();
    assert!(matches!(error, StepError::Attribute { .. }), "{error}");
    assert_eq!(cloth.backend(), Backend::Gpu);
    assert!(play(&mut cloth, 1, &air) < 1e-4);

    // On this machine the library chooses a GPU only if it is not a software driver.
    cloth.options.backend = Backend::Auto;
    assert!(play(&mut cloth, 20, &with_table) < 1e-3);
    assert_eq!(cloth.backend(), Backend::Cpu);
    let low = cloth.positions().unwrap().iter().map(|x| x.y).fold(f32::INFINITY, f32::min);
    assert!(low > -0.3, "it lies on the table: {low} m");
    assert!(cloth.positions().unwrap().iter().any(|x: &Vec3| x.y < -0.25), "it has reached it");
}
