//! The rotations of mesh colliders at their vertices.

use std::sync::Arc;

use glam::{Quat, Vec3};

use super::spins;
use crate::model::mesh::Mesh;
use crate::step::plan::MeshBody;

/// Of a body that turns and moves on, every vertex turns like the body: by a vector along the axis that is twice the tangent of half the
/// angle long. One that is still does not turn, nor does a triangle whose corners are in one line.
#[test]
fn each_vertex_turns_like_its_body() {
    let sheet = Mesh::grid(5, 4, 0.4, 0.3);
    for (axis, angle) in [(Vec3::X, 0.5_f32), (Vec3::Y, -0.02), (Vec3::new(0.6, 0.0, 0.8), 1.5)] {
        let turn = Quat::from_axis_angle(axis, angle);
        let to = sheet.positions.iter().map(|&x| turn * x + Vec3::new(0.3, -0.1, 2.0)).collect();
        let moved = Arc::new(Mesh { positions: to, triangles: sheet.triangles.clone() });
        let body = MeshBody { from: Arc::new(sheet.clone()), to: moved, friction: 0.3 };
        let exact = axis * 2.0 * (0.5 * angle).tan();
        for (vertex, spin) in spins(&body).into_iter().enumerate() {
            assert!(spin.distance(exact) < 1e-4, "vertex {vertex} turns by {spin}, expected {exact}");
        }
    }
    let line = Arc::new(Mesh { positions: vec![Vec3::ZERO, Vec3::X, 2.0 * Vec3::X], triangles: vec![[0, 1, 2]] });
    let turned = Arc::new(Mesh { positions: vec![Vec3::ZERO, Vec3::Y, 2.0 * Vec3::Y], triangles: vec![[0, 1, 2]] });
    for to in [&line, &turned] {
        assert_eq!(spins(&MeshBody { from: line.clone(), to: to.clone(), friction: 0.3 }), [Vec3::ZERO; 3]);
    }
}
