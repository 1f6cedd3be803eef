//! Baselines that must fail where the solver passes: plain small-step XPBD (Macklin et al. 2019), and the solver's own
//! edge constraint in an unsafe order. In single precision; they share no code with the solver.

use cloth_deformer::glam::Vec3;

use super::reference::Spring;

/// How an edge is corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scheme {
    /// Compliance `1/(k h²)`, current direction, velocities `(x - x_prev) / h`.
    Plain,
    /// Compliance reduced by half the weights, direction at the substep's start (guarded), displacements as unknowns,
    /// and a first kick of half a substep.
    FourChanges,
}

/// Vertices and edges; the edges are swept once per substep in the given order.
#[derive(Debug, Clone)]
pub struct Baseline {
    scheme: Scheme,
    pub x: Vec<Vec3>,
    pub v: Vec<Vec3>,
    inverse_mass: Vec<f32>,
    springs: Vec<Spring>,
    pub gravity: Vec3,
    pub damping: f32,
    started: bool,
}

impl Baseline {
    /// At rest at `x` (m), in gravity along -y, undamped. Springs are visited in the given order.
    pub fn new(scheme: Scheme, x: Vec<Vec3>, springs: Vec<Spring>, masses: &[f32], pinned: &[u32]) -> Baseline {
        let mut inverse_mass: Vec<f32> = masses.iter().map(|m| 1.0 / m).collect();
        for &v in pinned {
            inverse_mass[v as usize] = 0.0;
        }
        let v = vec![Vec3::ZERO; x.len()];
        let gravity = Vec3::new(0.0, -9.81, 0.0);
        Baseline { scheme, x, v, inverse_mass, springs, gravity, damping: 0.0, started: false }
    }

    /// Steps `frames` frames of 1/60 s.
    pub fn play(&mut self, frames: u32, substeps: u32) {
        let h = 1.0 / (60 * substeps) as f32;
        for _ in 0..frames * substeps {
            self.substep(h);
        }
    }

    fn substep(&mut self, h: f32) {
        let kick = if self.scheme == Scheme::FourChanges && !self.started { 0.5 * h } else { h };
        self.started = true;
        for (v, &w) in self.v.iter_mut().zip(&self.inverse_mass) {
            *v = if w > 0.0 { (*v + self.gravity * kick) / (1.0 + self.damping * h) } else { Vec3::ZERO };
        }
        match self.scheme {
            Scheme::Plain => {
                let before = self.x.clone();
                self.x.iter_mut().zip(&self.v).for_each(|(x, v)| *x += *v * h);
                for &(i, j, rest, stiffness) in &self.springs {
                    let (d, w) = (self.x[i] - self.x[j], self.inverse_mass[i] + self.inverse_mass[j]);
                    let compliance = 1.0 / (stiffness as f32 * h * h);
                    let impulse = d.normalize_or_zero() * (-(d.length() - rest as f32) / (w + compliance));
                    self.x[i] += impulse * self.inverse_mass[i];
                    self.x[j] -= impulse * self.inverse_mass[j];
                }
                self.v.iter_mut().zip(self.x.iter().zip(&before)).for_each(|(v, (x, before))| *v = (*x - *before) / h);
            }
            Scheme::FourChanges => {
                let mut u: Vec<Vec3> = self.v.iter().map(|v| *v * h).collect();
                for &(i, j, rest, stiffness) in &self.springs {
                    let (d0, du, rest) = (self.x[i] - self.x[j], u[i] - u[j], rest as f32);
                    let w = self.inverse_mass[i] + self.inverse_mass[j];
                    let compliance = (1.0 / (stiffness as f32 * h * h) - 0.5 * w).max(0.0);
                    let (d, length) = (d0 + du, (d0 + du).length());
                    let straight = d0.dot(d) > 0.9 * rest * rest && (length - rest).abs() < 0.05 * rest;
                    let direction = if straight { d0 / rest } else { d.normalize_or_zero() };
                    let impulse = direction * (-(length - rest) / (w + compliance));
                    u[i] += impulse * self.inverse_mass[i];
                    u[j] -= impulse * self.inverse_mass[j];
                }
                self.x.iter_mut().zip(&u).for_each(|(x, u)| *x += *u);
                self.v.iter_mut().zip(&u).for_each(|(v, u)| *v = *u / h);
            }
        }
    }
}
