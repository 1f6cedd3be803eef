//! The scenes: sheets that hang, swing, lie on each other, fall in heaps, and are twisted, a garment on a body, one that a limb
//! squeezes, and one that is too narrow.

use std::f32::consts::PI;

use std::sync::Arc;

use cloth_deformer::glam::{Affine3A, Quat, Vec3};
use cloth_deformer::{Collider, Mesh};

#[allow(dead_code, unreachable_pub, reason = "the tests share these shapes and make more")]
#[path = "../../tests/common/shapes.rs"]
mod shapes;

use shapes::{bent, capsule, sheets, tube};

pub(crate) struct Scene {
    pub name: &'static str,
    pub mesh: Mesh,
    pub substeps: u32,
    pub pinned: Vec<u32>,
    pub colliders: Vec<Collider>,
    /// Initial positions, if they are not those of the rest shape.
    pub start: Option<Vec<Vec3>>,
    /// Angle (rad) by which the pins at each end are turned per frame, in opposite directions.
    pub twist: f32,
    /// A body that sways and turns; the pins follow it.
    pub body: Option<Mesh>,
    /// A limb that goes along with the body, closes on it within 20 frames, and slides up and down along it.
    pub limb: Option<Mesh>,
    /// Number of frames before timing, and of frames that are timed.
    pub frames: [u32; 2],
}

/// A scene of loose cloth above a floor.
fn plain(name: &'static str, mesh: Mesh, substeps: u32, frames: [u32; 2]) -> Scene {
    let colliders = vec![Collider::plane(Vec3::ZERO, Vec3::Y)];
    Scene { name, mesh, substeps, pinned: Vec::new(), colliders, start: None, twist: 0.0, body: None, limb: None, frames }
}

/// A square sheet.
fn grid(n: u32) -> Mesh {
    Mesh::grid(n, n, 1.0, 1.0)
}

/// A sheet that hangs from one side.
fn hung(name: &'static str, frames: [u32; 2]) -> Scene {
    Scene { pinned: (0..64).collect(), colliders: Vec::new(), ..plain(name, grid(64), 40, frames) }
}

/// The motion of the body: .1 m to and fro and a sixth of a turn, in a second.
fn sway(frame: u32) -> Affine3A {
    let phase = (PI * frame as f32 / 30.0).sin();
    Affine3A::from_rotation_translation(Quat::from_rotation_y(0.5 * phase), 0.1 * phase * Vec3::X)
}

/// A sheet that stands on an edge.
fn on_edge(n: u32) -> Mesh {
    let mut mesh = grid(n);
    let turn = Quat::from_rotation_x(1.5);
    // A grid that is exactly flat would fall without folding.
    for (index, x) in (0_u16..).zip(&mut mesh.positions) {
        *x = turn * *x + Vec3::new(0.0, 0.6, 1e-4 * f32::from(index % 7));
    }
    mesh
}

/// A square sheet that lies folded over.
fn fold(name: &'static str, n: u32) -> Scene {
    Scene { start: Some(grid(n).positions.iter().map(bent).collect()), ..plain(name, grid(n), 20, [1, 60]) }
}

/// An upright capsule.
fn upright(half_length: f32, radius: f32, rings: u32) -> Mesh {
    let mut mesh = capsule(Vec3::X * -half_length, Vec3::X * half_length, radius, rings);
    let turn = Quat::from_rotation_z(0.5 * PI);
    mesh.positions.iter_mut().for_each(|x| *x = turn * *x);
    mesh
}

/// A garment of 10,000 vertices on a body of 19,880 triangles.
fn garment() -> Scene {
    let body = upright(0.5, 0.15, 71);
    let mesh = tube(0.165, 0.9, 100, 100);
    Scene { pinned: (0..100).collect(), colliders: Vec::new(), body: Some(body), ..plain("garment", mesh, 20, [30, 60]) }
}

/// A garment of 1,980 vertices between a body and an arm that leaves it less room than its thickness: 4 mm.
fn squeezed() -> Scene {
    let (body, mut limb) = (upright(0.45, 0.15, 24), upright(0.15, 0.05, 12));
    limb.positions.iter_mut().for_each(|x| x.x += 0.204);
    let mesh = tube(0.18, 0.6, 60, 33);
    let pinned = (0..60).collect();
    Scene { pinned, colliders: Vec::new(), body: Some(body), limb: Some(limb), ..plain("squeezed", mesh, 20, [30, 60]) }
}

/// A tube of 1,980 vertices that is worn by a body and 3 % too narrow for it: all of it presses on the body.
fn worn() -> Scene {
    let (body, mesh) = (upright(0.3, 0.15, 24), tube(0.97 * 0.155, 0.4, 60, 33));
    let widened = mesh.positions.iter().map(|x| *x * Vec3::new(1.0 / 0.96, 1.0, 1.0 / 0.96)).collect();
    Scene { colliders: Vec::new(), start: Some(widened), body: Some(body), ..plain("worn", mesh, 20, [30, 60]) }
}

pub(crate) fn scenes() -> Vec<Scene> {
    let mut lying = sheets(2, 32, 1.0, 0.006);
    lying.positions.iter_mut().for_each(|x| x.y -= 0.001);
    vec![
        hung("hangs, 64", [120, 60]),
        hung("swings, 64", [1, 24]),
        plain("two lie, 32", lying, 20, [60, 30]),
        fold("fold, 20", 20),
        fold("fold, 40", 40),
        plain("heap, 16", on_edge(16), 20, [20, 70]),
        plain("heap, 32", on_edge(32), 20, [20, 70]),
        plain("heap, 64", on_edge(64), 40, [20, 30]),
        garment(),
        squeezed(),
        worn(),
    ]
}

/// Scenes that are large enough for a GPU.
pub(crate) fn large() -> Vec<Scene> {
    let drape = |name, height: f32, frames| {
        let mut mesh = Mesh::grid(128, 128, 1.2, 1.2);
        mesh.positions.iter_mut().for_each(|x| x.y += height);
        let mut scene = plain(name, mesh, 20, frames);
        scene.colliders.insert(0, Collider::sphere(0.3 * Vec3::Y, 0.3));
        scene
    };
    let twisted = |name, n: u32| Scene {
        pinned: (0..n).flat_map(|row| [row * n, row * n + n - 1]).collect(),
        colliders: Vec::new(),
        twist: PI / 180.0,
        ..plain(name, grid(n), 40, [120, 180])
    };
    let mut all = vec![
        drape("drape, 128, falling", 2.2, [4, 26]),
        drape("drape, 128, folding", 0.62, [5, 20]),
        drape("drape, 128, at rest", 0.62, [150, 60]),
        plain("stack of 10, 64", sheets(10, 64, 1.0, 0.008), 40, [60, 60]),
        twisted("twist, 50", 50),
        twisted("twist, 100", 100),
    ];
    all.extend(scenes());
    all
}

impl Scene {
    /// The pins' positions in a frame, if they move.
    pub(crate) fn targets(&self, frame: u32) -> Option<Vec<Vec3>> {
        let sway = sway(frame);
        let moved = |&pin: &u32| {
            let x = self.mesh.positions[pin as usize];
            let turn = Quat::from_rotation_x(self.twist * frame as f32 * x.x.signum());
            if self.body.is_some() { sway.transform_point3(x) } else { turn * x }
        };
        (self.twist > 0.0 || self.body.is_some()).then(|| self.pinned.iter().map(moved).collect())
    }

    /// The colliders in a frame; with the body only if it `has_contact`.
    pub(crate) fn colliders(&self, frame: u32, has_contact: bool) -> Vec<Collider> {
        let mut colliders = self.colliders.clone();
        if has_contact {
            let apart = 0.1 - 0.005 * frame.min(20) as f32;
            let limb = Vec3::new(apart, 0.05 * (0.1 * frame.saturating_sub(20) as f32).sin(), 0.0);
            let bodies = [(&self.body, Vec3::ZERO), (&self.limb, limb)].into_iter();
            colliders.extend(bodies.filter_map(|(body, by)| Some(swayed(body.as_ref()?, by, frame))));
        }
        colliders
    }
}

/// A body in a frame, moved besides.
fn swayed(body: &Mesh, by: Vec3, frame: u32) -> Collider {
    let sway = sway(frame);
    let positions = body.positions.iter().map(|&x| sway.transform_point3(x + by)).collect();
    Collider::mesh(Arc::new(Mesh { positions, triangles: body.triangles.clone() }))
}
