//! The sheet of a cell: 1 m x 1 m, pinned along its top edge.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Fabric, Mesh};

use crate::common::reference::{Spring, springs};
use crate::common::{grid_masses, rms, top};

/// Acceleration of gravity (m/s²).
pub(crate) const G: f64 = 9.81;
/// Areal density (kg/m²).
pub(crate) const DENSITY: f64 = 0.2;
/// Largest distance from the plane at the start (m).
const NOISE: f32 = 1e-5;
/// Root mean square speed of the jolt (m/s).
pub(crate) const JOLT: f64 = 0.1;

/// The parameters of a sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sheet {
    /// Vertices per side.
    pub(crate) n: u32,
    /// Membrane stiffness (N/m); infinite if inextensible.
    pub(crate) stretch: f64,
    /// Bending rigidity (N m).
    pub(crate) bending: f64,
    /// Mass of a vertex of the bottom row relative to the mass by density.
    pub(crate) mass_ratio: f64,
}

impl Sheet {
    /// A sheet of median fabric without bending.
    pub(crate) fn cotton(n: u32) -> Sheet {
        Sheet { n, stretch: 5000.0, bending: 0.0, mass_ratio: 1.0 }
    }

    /// Length of an edge along an axis (m).
    pub(crate) fn spacing(&self) -> f64 {
        1.0 / f64::from(self.n - 1)
    }

    pub(crate) fn mesh(&self) -> Mesh {
        Mesh::grid(self.n, self.n, 1.0, 1.0)
    }

    pub(crate) fn fabric(&self) -> Fabric {
        Fabric { density: DENSITY as f32, stretch: self.stretch as f32, bending: self.bending as f32, damping: 0.0 }
    }

    pub(crate) fn pinned(&self) -> Vec<u32> {
        top(self.n)
    }

    /// Mass of each vertex (kg).
    pub(crate) fn masses(&self) -> Vec<f32> {
        let mut masses = grid_masses(self.n, DENSITY as f32);
        let bottom = masses.len() - self.n as usize;
        masses[bottom..].iter_mut().for_each(|mass| *mass *= self.mass_ratio as f32);
        masses
    }

    /// Inverse mass of each vertex (1/kg), 0 where pinned.
    pub(crate) fn inverse_masses(&self) -> Vec<f64> {
        let n = self.n as usize;
        self.masses().iter().enumerate().map(|(v, &mass)| if v < n { 0.0 } else { 1.0 / f64::from(mass) }).collect()
    }

    /// The springs with at least one free end.
    pub(crate) fn springs(&self) -> Vec<Spring> {
        let mut springs = springs(&self.mesh(), self.stretch);
        springs.retain(|&(_, j, ..)| j >= self.n as usize);
        springs
    }

    /// Work of gravity on the way from horizontal to hanging down (J): `m g L/2` for an even sheet.
    pub(crate) fn fall(&self) -> f64 {
        let weigh = |(v, mass): (u32, f32)| f64::from(mass) * G * f64::from(v / self.n) * self.spacing();
        (0..).zip(self.masses()).map(weigh).sum()
    }

    /// The initial state: horizontal and at rest, displaced out of its plane by seeded noise; positions and velocities.
    pub(crate) fn level(&self) -> (Vec<Vec3>, Vec<Vec3>) {
        let mut random = fastrand::Rng::with_seed(1);
        let mut x = self.mesh().positions;
        x.iter_mut().skip(self.n as usize).for_each(|x| x.y = NOISE * (2.0 * random.f32() - 1.0));
        let rest = vec![Vec3::ZERO; x.len()];
        (x, rest)
    }

    /// The state of the second phase: hanging straight down, stretched by the load, and jolted. Each vertex gets a
    /// random velocity such that all have the same kinetic energy on average.
    pub(crate) fn jolted(&self) -> (Vec<Vec3>, Vec<Vec3>) {
        let (n, spacing) = (self.n as usize, self.spacing());
        let masses = self.masses();
        let below = |row: usize| masses[row * n..].iter().map(|&mass| f64::from(mass)).sum::<f64>() * G;
        let mut height = 0.0;
        let mut heights = vec![0.0];
        for row in 1..n {
            height -= spacing * (1.0 + below(row) / self.stretch);
            heights.push(height);
        }
        let mut x = self.mesh().positions;
        x.iter_mut().enumerate().for_each(|(v, x)| (x.y, x.z) = (heights[v / n] as f32, -0.5));
        let mut random = fastrand::Rng::with_seed(2);
        let mut direction = || Vec3::from_array([0; 3].map(|_: i32| 2.0 * random.f32() - 1.0));
        let mut v: Vec<Vec3> = masses.iter().map(|mass| direction() / mass.sqrt()).collect();
        v[..n].fill(Vec3::ZERO);
        let scale = JOLT / rms(&v, &vec![Vec3::ZERO; v.len()]);
        v.iter_mut().for_each(|v| *v *= scale as f32);
        (x, v)
    }
}
