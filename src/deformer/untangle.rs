//! Cloth that goes through itself or through bodies, parted before it moves.

use glam::{Vec3, Vec4};

use super::Deformer;
use crate::attributes::{Attributes, Shape};
use crate::contact::untangle::untangle;
use crate::error::StepError;
use crate::model::mesh::Mesh;

/// What [`Deformer::untangle`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Untangled {
    /// Edges that went through triangles before, of the cloth and of the bodies.
    pub before: usize,
    /// Those that are left.
    pub after: usize,
    /// How far (m) the vertex that was moved the most was moved.
    pub farthest: f32,
}

impl Deformer {
    /// Tries to part cloth that goes through itself or through mesh colliders where it is now: garments are often modeled so. Vertices are moved
    /// as little as need be, velocities stay, pins stay where they are, and bodies are where the attributes have them. Vertices inside a closed
    /// mesh are taken out of it. Cloth that crosses nothing is left as it is, bit for bit.
    ///
    /// Contours of intersection are shortened until they vanish (Volino and Magnenat-Thalmann 2006), which is a local method: it may not find
    /// the way out. [`Untangled::after`] says what is left; [`Options::contact`](crate::Options::contact)
    /// lets it go until it parts. Takes up to some hundred rounds, each of about the time of [`Deformer::crossings`].
    ///
    /// # Errors
    /// If an attribute is out of its range, and as [`Deformer::positions`]; the state is then as it was.
    pub fn untangle(&mut self, attributes: &Attributes) -> Result<Untangled, StepError> {
        attributes.validate(self.cloth.pinned.len())?;
        self.positions()?;
        let origin = self.cloth.origin;
        let bodies: Vec<Mesh> = attributes
            .colliders
            .iter()
            .filter_map(|collider| match &collider.shape {
                Shape::Mesh { mesh } => {
                    let positions = mesh.positions.iter().map(|&x| x - origin).collect();
                    Some(Mesh { positions, triangles: mesh.triangles.clone() })
                }
                _ => None,
            })
            .collect();
        let mut x: Vec<Vec4> = self.local.clone();
        let thickness = self.options.contact.unwrap_or_default().thickness;
        let [before, after] = untangle(&self.cloth, &mut x, &bodies, thickness);
        let moved = x.iter().zip(&self.local).map(|(to, from)| to.truncate().distance(from.truncate()));
        let farthest = moved.fold(0.0, f32::max);
        if farthest > 0.0 {
            let mut positions: Vec<Vec3> = self.positions.clone();
            let placed = self.cloth.order.iter().zip(x.iter().zip(&self.local)).filter(|(_, (to, from))| to != from);
            placed.for_each(|(&vertex, (to, _))| positions[vertex as usize] = to.truncate() + origin);
            let velocities = self.velocities.clone();
            self.set_state(&positions, &velocities)?;
        }
        Ok(Untangled { before, after, farthest })
    }
}
