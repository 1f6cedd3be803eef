//! The imperfection without which a flat cloth could not buckle.

use glam::Vec3;

use crate::deformer::Deformer;
use crate::error::StepError;

/// How far vertices are moved out of the plane, as a share of the largest coordinate.
const IMPERFECTION: f64 = 1e-6;
/// A force that has a larger share than this across the plane bends the cloth itself.
const ACROSS: f64 = 1e-6;

impl Deformer {
    /// Before the first step from a state, moves the free vertices of exactly flat parts out of their plane, each by up to
    /// a millionth of their size. Compression within the plane has no reason to bend such a part to one side rather than
    /// the other, so it would be crushed there, however far; real cloth is never that flat. Where gravity acts across the
    /// plane it bends the cloth by itself, so nothing is moved.
    pub(super) fn make_imperfect(&mut self, gravity: Vec3) -> Result<(), StepError> {
        let gravity = gravity.as_dvec3();
        let is_along = |normal| gravity.dot(normal).abs() <= ACROSS * gravity.length();
        if self.motion.dt > 0.0 || !self.cloth.flat_parts().iter().any(|part| is_along(part.normal)) {
            return Ok(());
        }
        let [mut x, p] = self.read_state()?;
        for part in self.cloth.flat_parts().iter().filter(|part| is_along(part.normal)) {
            if !part.is_flat(&x) {
                continue;
            }
            let most = IMPERFECTION * part.size(&x);
            for &vertex in &part.vertices {
                let x = &mut x[vertex as usize];
                if x.w > 0.0 {
                    let by = part.normal * (most * noise(self.cloth.order[vertex as usize]));
                    *x += by.as_vec3().extend(0.0);
                }
            }
        }
        self.engine.set(&x, &p);
        self.is_current = false;
        Ok(())
    }
}

/// A number from -1 to 1 for each vertex that follows no pattern of the mesh (multiplicative hashing).
fn noise(vertex: u32) -> f64 {
    let mixed = vertex.wrapping_mul(0x9e37_79b9).rotate_left(16).wrapping_mul(0x85eb_ca6b);
    f64::from(mixed) / f64::from(u32::MAX) * 2.0 - 1.0
}
