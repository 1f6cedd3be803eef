//! Validation of the mesh and the options that a cloth is built from.

use glam::Vec3;

use crate::error::BuildError;
use crate::kernels::limits::MAX_VERTICES;
use crate::model::masses::is_mass;
use crate::model::mesh::Mesh;
use crate::options::Options;

/// The smallest areal density (kg/m²) with which triangles of ordinary size have masses in the range of single precision.
const LIGHTEST: f32 = 1e-20;

/// Checks the number and the range of positions, and the triangles' indices.
pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), BuildError> {
    let vertices = mesh.positions.len();
    if vertices == 0 {
        return Err(BuildError::NoVertices);
    }
    if vertices > MAX_VERTICES {
        return Err(BuildError::TooManyVertices { vertices });
    }
    if let Some(vertex) = mesh.unbounded_vertex() {
        return Err(BuildError::Position { vertex, position: mesh.positions[vertex] });
    }
    match mesh.missing_vertex() {
        Some((triangle, index)) => Err(BuildError::Index { triangle, index, vertices }),
        None => Ok(()),
    }
}

/// Bounds on the thickness of contact as shares of the cloth's size. Below the first, rounding of positions is as much as what
/// contact leaves between cloth that touches, and heaps cross at any number of substeps.
const MIN_THICKNESS: f64 = 1e-4;
pub(crate) const MAX_THICKNESS: f64 = 0.5;
/// What contact may compare: so many vertices within the thickness of each, or so many pairs of such vertices in all, each of
/// which takes about 350 bytes.
const NEAR: usize = 16;
const PAIRS: u64 = 1 << 20;
/// Number of vertices around which they are counted.
const SAMPLES: usize = 32;

/// Checks the thickness (m) of contact on cloth at rest (m) whose size is `extent` (m).
pub(crate) fn check_thickness(rest: &[Vec3], extent: f64, thickness: f32) -> Result<(), BuildError> {
    let refuse = |value: String, remedy| Err(BuildError::value("contact.thickness", value, remedy));
    let on_cloth = || format!("{thickness} m on cloth {} m across", extent as f32);
    let [least, most] = [MIN_THICKNESS, MAX_THICKNESS].map(|share| share * extent);
    if thickness < least as f32 {
        let remedy = "must be at least 0.0001 of that, since positions in single precision keep no smaller distance; choose more";
        return refuse(on_cloth(), remedy);
    }
    if f64::from(thickness) > most && extent > 0.0 {
        return refuse(on_cloth(), "must be at most half of that; choose less");
    }
    // The golden ratio spreads the samples evenly; a stride might follow the border of a grid.
    let places = (0..SAMPLES).map(|k| ((k as f64 * 0.618_034).fract() * rest.len() as f64) as usize);
    let within = |center: Vec3| rest.iter().filter(|x| x.distance_squared(center) < thickness * thickness).count();
    // Without the center itself.
    let near = |center| within(center).saturating_sub(1);
    let near = places.map(|place| near(rest[place])).sum::<usize>() / SAMPLES;
    if near > NEAR && near as u64 * rest.len() as u64 > PAIRS {
        let value = format!("{thickness} m, within which a vertex has about {near} others");
        return refuse(value, "all these are compared; choose less, or a coarser mesh");
    }
    Ok(())
}

/// Checks the options for a mesh with so many vertices and edges.
pub(crate) fn check_options(vertices: usize, edges: usize, options: &Options) -> Result<(), BuildError> {
    let value = |name: &str, value: f32, holds: bool, remedy: &'static str| {
        if holds { Ok(()) } else { Err(BuildError::value(name, value, remedy)) }
    };
    let not_negative: fn(f32) -> bool = |x| x >= 0.0 && x.is_finite();
    let fabric = options.fabric;
    let is_density = (LIGHTEST..=f32::MAX).contains(&fabric.density);
    value("fabric.density", fabric.density, is_density, "must be finite and at least 1e-20 kg/m2")?;
    value("fabric.stretch", fabric.stretch, fabric.stretch > 0.0, "must be above 0 N/m, or infinite for inextensible")?;
    value("fabric.bending", fabric.bending, not_negative(fabric.bending), "must be finite and 0 N m or above")?;
    value("fabric.damping", fabric.damping, not_negative(fabric.damping), "must be finite and 0 s or above")?;
    options.check_numbers()?;

    let mut is_pinned = vec![false; vertices];
    for (slot, &index) in options.pinned.iter().enumerate() {
        let Some(pinned) = is_pinned.get_mut(index as usize) else { return Err(BuildError::Pin { slot, index, vertices }) };
        if std::mem::replace(pinned, true) {
            return Err(BuildError::PinTwice { slot, index });
        }
    }
    let length = |name, list: &[f32], expected, things| {
        if list.len() == expected { Ok(()) } else { Err(BuildError::Length { name, given: list.len(), expected, things }) }
    };
    let each = |name: &str, list: &[f32], holds: fn(f32) -> bool, remedy| match list.iter().position(|&x| !holds(x)) {
        None => Ok(()),
        Some(index) => value(&format!("{name}[{index}]"), list[index], false, remedy),
    };
    if let Some(mass) = &options.mass {
        length("mass", mass, vertices, "vertices")?;
        each("mass", mass, is_mass, "must be from 1.2e-38 to 8.5e37 kg; use `pinned` for a fixed vertex")?;
    }
    if let Some(scale) = &options.edge_scale {
        length("edge_scale", scale, edges, "edges")?;
        each("edge_scale", scale, not_negative, "must be finite and 0 or above")?;
    }
    if let Some(scale) = &options.bending_scale {
        length("bending_scale", scale, vertices, "vertices")?;
        each("bending_scale", scale, not_negative, "must be finite and 0 or above")?;
    }
    Ok(())
}
