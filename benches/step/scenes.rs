//! The scenes that are timed.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Collider, Deformer, Fabric, Levels, Mesh, Options, Quality};

pub(crate) const FRAME: f32 = 1.0 / 60.0;
pub(crate) const SUBSTEPS: u32 = 20;

pub(crate) type Scene = (Mesh, Options);

/// HANG: a sheet of 1 m with its first row pinned.
pub(crate) fn hang(n: u32, fabric: Fabric) -> Scene {
    let options = Options {
        backend: Backend::Cpu,
        quality: Quality::Substeps(SUBSTEPS),
        // The plain code has no levels; `terms` shows their cost.
        levels: Levels::Off,
        fabric,
        pinned: (0..n).collect(),
        ..Options::default()
    };
    (Mesh::grid(n, n, 1.0, 1.0), options)
}

pub(crate) fn bare() -> Fabric {
    Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 }
}

/// HANG with one more term each.
pub(crate) fn terms() -> Vec<(&'static str, Scene, Attributes)> {
    let air = Attributes { air_density: 1.2, wind: Vec3::new(1.0, 0.0, 2.0), ..Attributes::default() };
    let ball = Collider::sphere(Vec3::new(0.0, -0.5, 0.2), 0.3);
    let collider = Attributes { colliders: vec![ball], ..Attributes::default() };
    let bending = Fabric { bending: 1e-5, ..bare() };
    let scene = |fabric| hang(64, fabric);
    let (mesh, options) = scene(bare());
    vec![
        ("edges alone", scene(bare()), Attributes::default()),
        ("levels", (mesh, Options { levels: Levels::Auto, ..options }), Attributes::default()),
        ("bending", scene(bending), Attributes::default()),
        ("damped bending", scene(Fabric { damping: 0.03, ..bending }), Attributes::default()),
        ("wind", scene(bare()), air),
        ("sphere", scene(bare()), collider),
    ]
}

/// A cloth after half a second, no longer flat.
pub(crate) fn moving((mesh, options): &Scene, attributes: &Attributes) -> Deformer {
    let mut deformer = Deformer::new(mesh, options.clone()).expect("a sheet");
    (0..30).for_each(|_| frame(&mut deformer, attributes));
    deformer
}

/// One frame, waiting until it is done.
pub(crate) fn frame(deformer: &mut Deformer, attributes: &Attributes) {
    deformer.step(FRAME, attributes).expect("the sheet hangs");
    deformer.wait().expect("the device is there");
}
