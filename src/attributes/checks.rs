//! What attributes may be: every value is checked before a step begins.

use std::collections::HashMap;
use std::fmt::Display;

use glam::Vec3;

use crate::attributes::{Attributes, Collider, Shape};
use crate::error::StepError;
use crate::kernels::limits::{MAX_POSITION, MAX_VERTICES, is_bounded};
use crate::model::mesh::Mesh;

/// Up to so many colliders, each id is compared with each, which needs no memory.
const FEW: usize = 16;

impl Attributes {
    /// Checks every value; `pins` is the number of pinned vertices.
    pub(crate) fn validate(&self, pins: usize) -> Result<(), StepError> {
        within("gravity", self.gravity, "m/s2")?;
        within("wind", self.wind, "m/s")?;
        not_negative("air_density", self.air_density)?;
        not_negative("drag", self.drag)?;
        not_negative("lift", self.lift)?;
        not_negative("damping", self.damping)?;
        if self.lift > self.drag {
            return Err(invalid("lift", self.lift, format_args!("must not exceed drag = {}", self.drag)));
        }
        let mut with_id = HashMap::new();
        for (index, collider) in self.colliders.iter().enumerate() {
            collider.validate().map_err(|error| in_collider(index, error))?;
            let Some(id) = collider.id else { continue };
            let earlier = match self.colliders.len() {
                ..=FEW => self.colliders[..index].iter().position(|other| other.id == Some(id)),
                _ => with_id.insert(id, index),
            };
            if let Some(earlier) = earlier {
                let remedy = format_args!("is the id of colliders[{earlier}] too; give each its own");
                return Err(invalid(format_args!("colliders[{index}].id"), id, remedy));
            }
        }
        let Some(targets) = &self.pin_targets else { return Ok(()) };
        if targets.len() != pins {
            return Err(StepError::PinTargets { given: targets.len(), pinned: pins });
        }
        targets.iter().enumerate().try_for_each(|(slot, &target)| within(format_args!("pin_targets[{slot}]"), target, "m"))
    }
}

impl Collider {
    /// Checks every value, which an error names as a field of the collider.
    fn validate(&self) -> Result<(), StepError> {
        not_negative("friction", self.friction)?;
        match self.shape {
            Shape::Sphere { center, radius } => {
                within("center", center, "m")?;
                above_0("radius", radius)
            }
            Shape::Plane { point, normal } => {
                within("point", point, "m")?;
                if !normal.is_finite() {
                    return Err(invalid("normal", normal, "must be finite"));
                }
                if normal.as_dvec3().try_normalize().is_none() {
                    return Err(invalid("normal", normal, "has no direction; give a vector out of the solid"));
                }
                Ok(())
            }
            Shape::Capsule { a, b, radius } => {
                within("a", a, "m")?;
                within("b", b, "m")?;
                above_0("radius", radius)
            }
            Shape::TaperedCapsule { a, radius_a, b, radius_b } => {
                within("a", a, "m")?;
                within("b", b, "m")?;
                above_0("radius_a", radius_a)?;
                above_0("radius_b", radius_b)
            }
            Shape::RoundedBox { center, half, rotation, radius } => {
                within("center", center, "m")?;
                above_0("half.x", half.x)?;
                above_0("half.y", half.y)?;
                above_0("half.z", half.z)?;
                let square = rotation.as_dquat().length_squared();
                if !(square > 0.0 && square.is_finite()) {
                    let remedy = "has no direction; give a quaternion of finite numbers, Quat::IDENTITY for none";
                    return Err(invalid("rotation", rotation, remedy));
                }
                if !(0.0..=half.min_element()).contains(&radius) {
                    return Err(invalid("radius", radius, format_args!("must be from 0 m to the least of half = {half}")));
                }
                Ok(())
            }
            Shape::Mesh { ref mesh } => validate_mesh(mesh),
        }
    }
}

fn validate_mesh(mesh: &Mesh) -> Result<(), StepError> {
    let Mesh { positions, triangles } = mesh;
    // Corners, not areas: a body may shrink to a point for a while.
    if triangles.iter().all(|[a, b, c]| a == b || b == c || c == a) {
        let what = if triangles.is_empty() { "a mesh without triangles" } else { "a mesh without a triangle of three corners" };
        return Err(invalid("mesh", what, "has no surface; give it one, or leave it out"));
    }
    if positions.len() > MAX_VERTICES {
        return Err(invalid("mesh: vertices", positions.len(), format_args!("is more than {MAX_VERTICES}; split the mesh")));
    }
    if let Some(vertex) = mesh.unbounded_vertex() {
        return Err(invalid(format_args!("mesh.positions[{vertex}]"), positions[vertex], "must be finite and within 1e15 m"));
    }
    if let Some((triangle, _)) = mesh.missing_vertex() {
        let name = format_args!("mesh.triangles[{triangle}]");
        let remedy = format_args!("refers to a vertex that does not exist; the mesh has {}, numbered from 0", positions.len());
        return Err(invalid(name, format_args!("{:?}", triangles[triangle]), remedy));
    }
    Ok(())
}

pub(crate) fn invalid(name: impl Display, value: impl Display, remedy: impl Display) -> StepError {
    StepError::Attribute { name: name.to_string(), value: value.to_string(), remedy: remedy.to_string() }
}

/// The error of a field of the collider with this index.
fn in_collider(index: usize, error: StepError) -> StepError {
    match error {
        StepError::Attribute { name, value, remedy } => invalid(format_args!("colliders[{index}].{name}"), value, remedy),
        other => other,
    }
}

/// Checks that a vector is no larger than a position or a velocity may be: what is larger would move the cloth there.
fn within(name: impl Display, value: Vec3, unit: &str) -> Result<(), StepError> {
    if is_bounded(value) { Ok(()) } else { Err(invalid(name, value, format_args!("must be finite and within 1e15 {unit}"))) }
}

fn above_0(name: &str, radius: f32) -> Result<(), StepError> {
    if radius > 0.0 && radius <= MAX_POSITION {
        Ok(())
    } else {
        Err(invalid(name, radius, "must be above 0 m and at most 1e15 m"))
    }
}

fn not_negative(name: &str, value: f32) -> Result<(), StepError> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { Err(invalid(name, value, "must be finite and 0 or above")) }
}
