//! The imperfection without which a flat cloth could not buckle.

use glam::{DVec3, Vec3, Vec4};

use crate::deformer::Deformer;
use crate::error::StepError;
use crate::model::cloth::Cloth;

/// How far vertices may be out of the plane, as a share of the cloth's size: above the rounding of single precision.
const IMPERFECTION: f64 = 1e-6;
/// A force that has a larger share than this across the plane bends the cloth itself.
const ACROSS: f64 = 1e-6;

impl Deformer {
    /// Before the first step from a state, moves the free vertices of an exactly flat cloth out of its plane, each by up
    /// to a millionth of the cloth's size. Compression in its plane has no reason to bend such a cloth to one side rather
    /// than the other, so it would be crushed within the plane, however far; real cloth is never that flat. Where gravity
    /// acts across the plane it bends the cloth by itself, so nothing is moved.
    pub(super) fn make_imperfect(&mut self, gravity: Vec3) -> Result<(), StepError> {
        let cloth = &self.cloth;
        let rest = &cloth.rest[..cloth.used];
        let Some(normal) = normal(cloth).filter(|_| self.motion.dt == 0.0) else { return Ok(()) };
        let (size, gravity) = (size(rest), gravity.as_dvec3());
        if gravity.dot(normal).abs() > ACROSS * gravity.length() || !is_flat(rest, normal, size) {
            return Ok(());
        }
        let used = cloth.used;
        let [mut x, p] = self.read_state()?;
        if !is_flat(&x[..used], normal, size) {
            return Ok(());
        }
        for ((x, &vertex), _) in x.iter_mut().zip(&self.cloth.order).zip(0..used).filter(|((x, _), _)| x.w > 0.0) {
            *x += (normal * (IMPERFECTION * size * noise(vertex))).as_vec3().extend(0.0);
        }
        self.engine.set(&x, &p);
        self.is_current = false;
        Ok(())
    }
}

/// The normal of the first triangle with an area.
fn normal(cloth: &Cloth) -> Option<DVec3> {
    let at = |vertex: u32| cloth.rest[vertex as usize].truncate().as_dvec3();
    cloth.triangles.iter().find_map(|&[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a)).try_normalize())
}

/// The largest coordinate (m): positions are rounded to a ten-millionth of it.
fn size(x: &[Vec4]) -> f64 {
    f64::from(x.iter().map(|x| x.truncate().abs().max_element()).fold(0.0, f32::max))
}

fn is_flat(x: &[Vec4], normal: DVec3, size: f64) -> bool {
    let height = |x: &Vec4| x.truncate().as_dvec3().dot(normal);
    x.iter().all(|other| (height(other) - height(&x[0])).abs() <= 0.5 * IMPERFECTION * size)
}

/// A number from -1 to 1 for each vertex that follows no pattern of the mesh (multiplicative hashing).
fn noise(vertex: u32) -> f64 {
    let mixed = vertex.wrapping_mul(0x9e37_79b9).rotate_left(16).wrapping_mul(0x85eb_ca6b);
    f64::from(mixed) / f64::from(u32::MAX) * 2.0 - 1.0
}
