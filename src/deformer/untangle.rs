//! Separates cloth that crosses itself or mesh colliders before it moves.

use glam::Vec4;

use super::Deformer;
use crate::attributes::{Attributes, Collider};
use crate::contact::untangle::untangle;
use crate::error::StepError;
use crate::kernels::contact::Body;
use crate::model::mesh::Mesh;
use crate::step::bodies::moving;
use crate::step::motion::Motion;

/// The result of [`Deformer::untangle`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Untangled {
    /// Pairs of an edge and a triangle that crossed before, of the cloth and of mesh colliders. Cloth that is wholly inside a
    /// closed mesh crosses nothing and is not counted here, but is moved out of it: see `farthest`.
    pub before: usize,
    /// Pairs that still cross.
    pub after: usize,
    /// The largest distance (m) that a vertex was moved; 0 if nothing was changed.
    pub farthest: f32,
}

impl Deformer {
    /// Tries to separate cloth that crosses itself or mesh colliders in its present state, as garments are often
    /// modeled. Vertices are moved as little as necessary, velocities stay, pins stay where they are, and colliders are where the
    /// attributes place them; if anything is moved, the next step moves all colliders from there. No vertex is moved into a
    /// collider of another shape.
    /// Vertices inside a closed mesh are moved out of it, each the nearest way, which may stretch the edges between them to
    /// several times their length; the following steps draw them together. Cloth that crosses nothing and is inside of nothing stays as it is, bit for bit.
    ///
    /// The contours of intersection are shortened until they vanish (Volino and Magnenat-Thalmann 2006); where that does not
    /// help, the smaller side of a contour goes back through the other surface (Baraff, Witkin and Kass 2003). This is a
    /// local method, which may not find a way out: [`Untangled::after`] says what remains (if that would be more than nine
    /// tenths, nothing is moved), and [`Options::contact`](crate::Options::contact) ignores that until it has separated.
    /// It takes some hundred rounds, at most 1500, each of about the time of [`Deformer::crossings`].
    ///
    /// # Errors
    /// If an attribute is out of its range, those of [`Deformer::positions`], and [`StepError::Crowded`]; the state is then unchanged.
    pub fn untangle(&mut self, attributes: &Attributes) -> Result<Untangled, StepError> {
        attributes.validate(self.cloth.pinned.len())?;
        self.positions()?;
        let origin = self.cloth.origin;
        let meshes = attributes.colliders.iter().filter_map(|collider| collider.shape.mesh());
        let positions = |mesh: &Mesh| mesh.positions.iter().map(|&x| x - origin).collect();
        let bodies: Vec<Mesh> =
            meshes.map(|mesh| Mesh { positions: positions(mesh), triangles: mesh.triangles.clone() }).collect();
        let at_rest = |collider: &Collider| moving(collider, collider, &self.cloth);
        let analytic = attributes.colliders.iter().filter(|collider| collider.shape.mesh().is_none());
        let analytic: Vec<Body> = analytic.map(at_rest).collect();
        let mut x: Vec<Vec4> = self.local.clone();
        let thickness = self.options.contact.unwrap_or_default().thickness;
        let untangled = untangle(&self.cloth, &mut x, &bodies, &analytic, thickness);
        let [before, after] = untangled.map_err(|pairs| StepError::Crowded { pairs })?;
        let moved = x.iter().zip(&self.local).map(|(to, from)| to.truncate().distance(from.truncate()));
        let farthest = moved.fold(0.0, f32::max);
        if farthest > 0.0 {
            let Motion { dt, h, ambient, new_pins, pin_velocities, .. } = std::mem::take(&mut self.state.motion);
            self.set_local(&x, &self.velocities.clone(), h);
            // What moves goes on from where it is now.
            self.flat_start = self.flat_start.take().filter(|_| dt == 0.0 && h == 0.0);
            let motion = &mut self.state.motion;
            (motion.dt, motion.ambient, motion.new_pins, motion.pin_velocities) = (dt, ambient, new_pins, pin_velocities);
            self.state.motion.colliders.clone_from(&attributes.colliders);
        }
        Ok(Untangled { before, after, farthest })
    }
}
