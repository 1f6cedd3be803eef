//! The scene: a flag on a pole in gusts of wind, and the camera.

use cloth_deformer::glam::camera::rh::{proj, view};
use cloth_deformer::glam::{Mat4, Vec2, Vec3};
use cloth_deformer::{Attributes, Backend, BuildError, Deformer, Fabric, Gpu, Mesh, Options, Quality};

/// Length of a frame (s).
pub(crate) const FRAME: f32 = 1.0 / 60.0;
/// Length and height (m), and the number of vertices along each.
pub(crate) const SIZE: Vec2 = Vec2::new(1.5, 1.0);
const VERTICES: [u32; 2] = [121, 81];
/// Position of the camera, and the point it looks at (m).
pub(crate) const EYE: Vec3 = Vec3::new(1.25, -0.42, 2.9);
const LOOKS_AT: Vec3 = Vec3::new(0.68, -0.10, 0.0);

/// The flag at rest in the plane z = 0, with its pole side at x = 0 and its front toward +z.
pub(crate) fn mesh() -> Mesh {
    let mut mesh = Mesh::grid(VERTICES[0], VERTICES[1], SIZE.x, SIZE.y);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x + 0.5 * SIZE.x, -x.z, 0.0));
    mesh
}

/// Texture coordinates of the mesh's vertices, in units of the flag's height, from the top of its pole side.
pub(crate) fn uv(mesh: &Mesh) -> Vec<Vec2> {
    mesh.positions.iter().map(|x| Vec2::new(x.x, 0.5 * SIZE.y - x.y) / SIZE.y).collect()
}

/// The flag, sewn to its pole.
pub(crate) fn flag(backend: Backend, gpu: Option<Gpu>) -> Result<Deformer, BuildError> {
    let mesh = mesh();
    let pinned = (0..VERTICES[1]).map(|row| row * VERTICES[0]).collect();
    let fabric = Fabric { bending: 2e-5, damping: 0.03, ..Fabric::COTTON };
    // Bunting yields along the bias: only the threads, not the diagonals, are stiff.
    let slants = |&[a, b]: &[u32; 2]| a % VERTICES[0] != b % VERTICES[0] && a / VERTICES[0] != b / VERTICES[0];
    let edge_scale = Some(mesh.edges().iter().map(|edge| if slants(edge) { 0.05 } else { 1.0 }).collect());
    let quality = Quality::Substeps(30);
    Deformer::new(&mesh, Options { backend, gpu, fabric, pinned, edge_scale, quality, ..Options::default() })
}

/// The air at `time` (s): it blows along the flag, with varying direction and strength.
pub(crate) fn air(time: f32) -> Attributes {
    let gust = |rate: f32, phase: f32| (rate * time + phase).sin();
    let along = 7.5 + 1.5 * gust(2.1, 0.4) + 0.8 * gust(5.3, 1.0);
    let across = 4.2 * gust(4.4, 0.0) + 3.4 * gust(9.7, 2.0) + 2.0 * gust(17.0, 0.7);
    let up = 0.6 + 0.8 * gust(3.1, 0.2);
    Attributes { wind: Vec3::new(along, up, across), air_density: 1.225, ..Attributes::default() }
}

/// Transforms from the world to clip space, with depth 0 to 1.
pub(crate) fn camera(aspect: f32) -> Mat4 {
    proj::directx::perspective(0.60, aspect, 0.1, 20.0) * view::look_at_mat4(EYE, LOOKS_AT, Vec3::Y)
}
