//! The cape: its mesh, what it is made of, and what acts on it in a step.

use cloth_deformer::glam::{Affine3A, Vec2, Vec3};
use cloth_deformer::{Attributes, Backend, BuildError, Deformer, Fabric, Gpu, Mesh, Options, Quality};

use crate::body::Pose;

/// A step (s).
pub(crate) const STEP: f32 = 1.0 / 60.0;
/// Vertices along the collar and down the back; width and length (m).
const VERTICES: [u32; 2] = [33, 37];
const SIZE: Vec2 = Vec2::new(0.95, 1.1);
/// The collar: its height, how far behind the body's axis it is, its width once it is gathered (m), and how long that takes (s).
const HEIGHT: f32 = 1.53;
const BEHIND: f32 = 0.13;
const GATHERED: f32 = 0.40;
const GATHERING: f32 = 0.8;

/// The cape in the body's space, spread out behind it; its first row is the collar.
pub(crate) fn mesh() -> Mesh {
    let mut mesh = Mesh::grid(VERTICES[0], VERTICES[1], SIZE.x, SIZE.y);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, HEIGHT - 0.5 * SIZE.y - x.z, BEHIND + 0.05));
    mesh
}

/// Where each vertex is on the cape, from 0 to 1.
pub(crate) fn uv() -> Vec<[f32; 2]> {
    Mesh::grid(VERTICES[0], VERTICES[1], 1.0, 1.0).positions.iter().map(|x| [x.x + 0.5, x.z + 0.5]).collect()
}

/// The cape on a body, on the CPU or on a device of Bevy's.
///
/// # Errors
/// As [`Deformer::new`].
pub(crate) fn deformer(body: &Pose, backend: Backend, gpu: Option<Gpu>) -> Result<Deformer, BuildError> {
    let mut mesh = mesh();
    mesh.positions.iter_mut().for_each(|x| *x = body.root.transform_point3(*x));
    let pinned = (0..VERTICES[0]).collect();
    Deformer::new(
        &mesh,
        Options { backend, gpu, fabric: Fabric::COTTON, pinned, quality: Quality::Substeps(20), ..Options::default() },
    )
}

/// What acts on it in the step that leads to `body` at a time (s).
pub(crate) fn attributes(body: &Pose, time: f32) -> Attributes {
    let gathered = (time / GATHERING).min(1.0);
    let width = SIZE.x + (GATHERED - SIZE.x) * gathered;
    let collar = |column: u32| {
        let across = column as f32 / (VERTICES[0] - 1) as f32 - 0.5;
        // Around the neck: its ends are farther forward than its middle.
        let local = Vec3::new(width * across, HEIGHT, BEHIND + 0.05 * (1.0 - gathered) - 0.5 * gathered * across * across);
        body.root.transform_point3(local)
    };
    Attributes {
        colliders: body.colliders(),
        pin_targets: Some((0..VERTICES[0]).map(collar).collect()),
        air_density: 1.225,
        damping: 0.1,
        ..Attributes::default()
    }
}

/// What happens to the cape between two frames of the picture.
#[derive(Debug, Clone)]
pub(crate) enum Event {
    /// A step.
    Step(Box<Attributes>),
    /// It is put elsewhere, as if the world had moved.
    Warp(Affine3A),
}
