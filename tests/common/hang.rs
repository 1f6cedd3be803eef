//! The HANG scene, which most figures refer to.

use cloth_deformer::{Backend, Fabric, Mesh, Options, Quality};

/// The vertices of a grid's first row.
pub fn top(columns: u32) -> Vec<u32> {
    (0..columns).collect()
}

/// Masses (kg) of a grid of 1 m x 1 m with `density` (kg/m²), where border vertices have half a cell's mass and corners
/// a quarter.
pub fn grid_masses(n: u32, density: f32) -> Vec<f32> {
    let cell = density / ((n - 1) * (n - 1)) as f32;
    let half = |k: u32| if k == 0 || k == n - 1 { 0.5 } else { 1.0 };
    (0..n * n).map(|v| cell * half(v / n) * half(v % n)).collect()
}

/// HANG: a sheet of 1 m x 1 m with n x n vertices, K = 5000 N/m, rho = 0.2 kg/m², pinned along its first row,
/// horizontal at rest.
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
