//! Masses of the vertices, and which of them are pinned.

use crate::error::BuildError;
use crate::model::vertex_order;
use crate::options::Options;

/// Masses and pins as the options give them, in the cloth's order.
pub(crate) struct Weights {
    /// Masses (kg), of pinned vertices too.
    pub mass: Vec<f32>,
    /// Mean areal density (kg/m²).
    pub density: f64,
    /// Pinned vertices, in the order of the options.
    pub pinned: Vec<u32>,
    /// Inverse masses (1/kg), 0 where pinned and of vertices without edges.
    pub inverse_mass: Vec<f32>,
}

impl Weights {
    /// `area` is that of each vertex (m²), in the cloth's order, in which the first `used` vertices have edges.
    pub(crate) fn new(options: &Options, order: &[u32], area: &[f64], used: usize) -> Result<Weights, BuildError> {
        let (mass, density) = masses(options, order, area, used)?;
        let rank = vertex_order::inverse(order);
        let pinned: Vec<u32> = options.pinned.iter().map(|&vertex| rank[vertex as usize]).collect();
        let mut inverse_mass: Vec<f32> = mass.iter().map(|mass| 1.0 / mass).collect();
        inverse_mass[used..].fill(0.0);
        pinned.iter().for_each(|&vertex| inverse_mass[vertex as usize] = 0.0);
        Ok(Weights { mass, density, pinned, inverse_mass })
    }
}

/// Mass of each vertex (kg) and the mean areal density (kg/m²).
///
/// A vertex without triangles, or with degenerate ones only, has no area. It gets the mean mass of the others; if there
/// are none, an equal share of the mass of one square meter. The mass of such a vertex has no influence on how it moves
/// unless it is connected to others.
fn masses(options: &Options, order: &[u32], area: &[f64], used: usize) -> Result<(Vec<f32>, f64), BuildError> {
    let density = f64::from(options.fabric.density);
    let total: f64 = area.iter().sum();
    if let Some(mass) = &options.mass {
        let mass: Vec<f32> = order.iter().map(|&vertex| mass[vertex as usize]).collect();
        let weighed = mass[..used].iter().map(|&mass| f64::from(mass)).sum::<f64>();
        return Ok((mass, if total > 0.0 { weighed / total } else { density }));
    }
    let count = area.iter().filter(|&&area| area > 0.0).count();
    let mean = if count == 0 { 1.0 / area.len() as f64 } else { total / count as f64 };
    // Lower bound for the mass of slivers that are too thin for their mass to be inverted.
    let least = 1e-30;
    let mass: Vec<f32> = area.iter().map(|&area| (density * if area > 0.0 { area } else { mean }).max(least) as f32).collect();
    if mass.iter().all(|&mass| is_mass(mass)) {
        return Ok((mass, density));
    }
    let remedy = "makes vertices of this mesh too heavy for single precision; lower it";
    Err(BuildError::value("fabric.density", options.fabric.density, remedy))
}

/// Whether a mass (kg) and its inverse are normal floating-point numbers.
pub(crate) fn is_mass(mass: f32) -> bool {
    mass > 0.0 && mass.is_normal() && (1.0 / mass).is_normal()
}
