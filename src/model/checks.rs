//! Validation of the mesh and the options that a cloth is built from.

use glam::Vec3;

use crate::error::BuildError;
use crate::kernels::limits::{MAX_POSITION, MAX_VERTICES};
use crate::model::masses::is_mass;
use crate::model::mesh::Mesh;
use crate::options::Options;

/// Checks the number and the range of positions, and the triangles' indices.
pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), BuildError> {
    let vertices = mesh.positions.len();
    if vertices == 0 {
        return Err(BuildError::NoVertices);
    }
    if vertices > MAX_VERTICES {
        return Err(BuildError::TooManyVertices { vertices });
    }
    let inside = |position: &Vec3| position.is_finite() && position.abs().max_element() <= MAX_POSITION;
    if let Some(vertex) = mesh.positions.iter().position(|position| !inside(position)) {
        return Err(BuildError::Position { vertex, position: mesh.positions[vertex] });
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&index| index as usize >= vertices) {
            return Err(BuildError::Index { triangle, index, vertices });
        }
    }
    Ok(())
}

/// Checks the options for a mesh with so many vertices and edges.
pub(crate) fn check_options(vertices: usize, edges: usize, options: &Options) -> Result<(), BuildError> {
    let value = |name: &str, value: f32, holds: bool, remedy: &'static str| match holds {
        true => Ok(()),
        false => Err(BuildError::Value { name: name.to_owned(), value: value.to_string(), remedy }),
    };
    let positive = |x: f32| x > 0.0 && x.is_finite();
    let not_negative: fn(f32) -> bool = |x| x >= 0.0 && x.is_finite();
    let fabric = options.fabric;
    value("fabric.density", fabric.density, positive(fabric.density), "must be finite and above 0 kg/m2")?;
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
    let length = |name, list: &[f32], expected, things| match list.len() == expected {
        true => Ok(()),
        false => Err(BuildError::Length { name, given: list.len(), expected, things }),
    };
    let each = |name: &str, list: &[f32], holds: fn(f32) -> bool, remedy| match list.iter().position(|&x| !holds(x)) {
        None => Ok(()),
        Some(index) => value(&format!("{name}[{index}]"), list[index], false, remedy),
    };
    if let Some(mass) = &options.mass {
        length("mass", mass, vertices, "vertices")?;
        each("mass", mass, is_mass, "must be finite and above 0 kg; use `pinned` for a fixed vertex")?;
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
