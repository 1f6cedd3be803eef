//! What the test files share: scenes, the f64 reference, and the list of backends.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

pub mod chain;
pub mod delaunay;
pub mod energy;
pub mod plain_xpbd;
pub mod reference;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Mesh, Options, Quality};

/// A frame [s].
pub const FRAME: f32 = 1.0 / 60.0;

/// Vertices of a grid's first row.
pub fn top(columns: u32) -> Vec<u32> {
    (0..columns).collect()
}

/// Masses [kg] that give a grid's borders half of a cell and its corners a quarter: `density` [kg/m²] on 1 m x 1 m.
pub fn grid_masses(n: u32, density: f32) -> Vec<f32> {
    let cell = density / ((n - 1) * (n - 1)) as f32;
    let half = |k: u32| if k == 0 || k == n - 1 { 0.5 } else { 1.0 };
    (0..n * n).map(|v| cell * half(v / n) * half(v % n)).collect()
}

/// HANG: a sheet of 1 m x 1 m, n x n vertices, K = 5000, rho = 0.2, its first row pinned, horizontal at rest.
pub fn hang(n: u32, substeps: u32, backend: Backend) -> (Mesh, Options) {
    let options = Options {
        backend,
        quality: Quality::Substeps(substeps),
        fabric: Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 },
        pinned: top(n),
        mass: Some(grid_masses(n, 0.2)),
        ..Options::default()
    };
    (Mesh::grid(n, n, 1.0, 1.0), options)
}

/// Steps `frames` frames of 1/60 s.
pub fn play(deformer: &mut Deformer, frames: u32, attributes: &Attributes) {
    for _ in 0..frames {
        deformer.step(FRAME, attributes).expect("the step succeeds");
    }
}

/// Root mean square distance [m] over vertices.
pub fn rms(a: &[Vec3], b: &[Vec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.as_dvec3().distance_squared(b.as_dvec3())).sum();
    (sum / a.len() as f64).sqrt()
}

/// Makes a test of each function for each backend, named `backend::function`. A build without the `gpu` feature is how a
/// run asks for the CPU alone; with it, a machine without an adapter fails these tests.
#[macro_export]
macro_rules! on_every_backend {
    ($($test:ident),+ $(,)?) => {
        mod cpu {
            $(#[test] fn $test() { super::$test(cloth_deformer::Backend::Cpu); })+
        }
        #[cfg(feature = "gpu")]
        mod hybrid {
            $(#[test] fn $test() { super::$test(cloth_deformer::Backend::Hybrid); })+
        }
        #[cfg(feature = "gpu")]
        mod gpu {
            $(#[test] fn $test() { super::$test(cloth_deformer::Backend::Gpu); })+
        }
    };
}
