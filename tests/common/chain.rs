//! Chains, and the frequency and amplitude of sampled vibrations.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Backend, Fabric, Mesh, Options, Quality};

/// A chain through `points`. Each of its edges is a triangle that names its second vertex twice.
pub fn chain(points: Vec<Vec3>) -> Mesh {
    let triangles = (1..points.len() as u32).map(|i| [i - 1, i, i]).collect();
    Mesh { positions: points, triangles }
}

/// A straight chain of `n` vertices along x, from 0 to `length` (m).
pub fn straight(n: u32, length: f32) -> Mesh {
    chain((0..n).map(|i| Vec3::X * (length * i as f32 / (n - 1) as f32)).collect())
}

/// Masses (kg) of a chain that represents a ribbon 1 m long and as wide as its edges are long; the vertices at the ends
/// have half an edge's mass.
///
/// An edge without area gets the stiffness of a square, K (N/m), so such a ribbon has the K and rho (kg/m²) of a sheet.
pub fn ribbon_masses(n: u32, density: f32) -> Vec<f32> {
    let square = density / ((n - 1) * (n - 1)) as f32;
    (0..n).map(|i| if i == 0 || i == n - 1 { 0.5 * square } else { square }).collect()
}

/// Options of a chain with given masses.
pub fn options(stretch: f32, mass: Vec<f32>, pinned: Vec<u32>, substeps: u32, backend: Backend) -> Options {
    Options {
        backend,
        quality: Quality::Substeps(substeps),
        fabric: Fabric { stretch, ..Fabric::default() },
        pinned,
        mass: Some(mass),
        ..Options::default()
    }
}

/// Substeps per frame that resolve the stiffness: `S* = (N - 1)/(60 L) sqrt(K/rho)`, for rho = 0.2 kg/m² and L = 1 m.
pub fn resolved(n: u32, stretch: f32) -> f32 {
    (n - 1) as f32 / 60.0 * (stretch / 0.2).sqrt()
}

/// Frequency (Hz) of a sinusoid sampled every `dt` (s), from a least-squares fit of
/// `x[k+1] + x[k-1] = 2 cos(w dt) x[k]`.
pub fn frequency(samples: &[f64], dt: f64) -> f64 {
    let sums = samples.windows(3).map(|x| (x[1] * (x[0] + x[2]), 2.0 * x[1] * x[1]));
    let (top, bottom) = sums.fold((0.0, 0.0), |sum, term| (sum.0 + term.0, sum.1 + term.1));
    (top / bottom).acos() / (std::f64::consts::TAU * dt)
}

/// Amplitude of a sinusoid times `sin(w dt)`, from the mean of `x[k]² - x[k-1] x[k+1] = A² sin²(w dt)`.
pub fn amplitude(samples: &[f64]) -> f64 {
    let squares: f64 = samples.windows(3).map(|x| x[1] * x[1] - x[0] * x[2]).sum();
    (squares / (samples.len() - 2) as f64).sqrt()
}
