//! A rigid motion applied to a cloth's whole state, in the cloth's local coordinates.

use glam::{Affine3A, DMat3, DQuat, DVec3, Vec3, Vec4};

/// How far a matrix may deviate from a rotation by rounding errors: the largest entry of `R^T R - 1`.
const ROUNDING: f64 = 1e-3;

/// A rotation followed by a translation (m), in the caller's coordinates.
pub(crate) struct Rigid {
    rotation: DQuat,
    translation: DVec3,
    /// Origin of the cloth's local coordinates (m).
    origin: DVec3,
}

impl Rigid {
    /// For a cloth with local coordinates at `origin`. If the motion is not rigid, returns what is wrong with it.
    pub(crate) fn new(motion: Affine3A, origin: Vec3) -> Result<Rigid, &'static str> {
        let matrix = DMat3::from_cols_array(&motion.matrix3.to_cols_array().map(f64::from));
        if !motion.is_finite() {
            return Err("is not finite");
        }
        let error = matrix.transpose() * matrix - DMat3::IDENTITY;
        if error.to_cols_array().iter().any(|entry| entry.abs() > ROUNDING) {
            return Err("scales or shears");
        }
        if matrix.determinant() < 0.0 {
            return Err("mirrors");
        }
        // Normalized, because repeated warps would accumulate the matrix's rounding errors.
        let rotation = DQuat::from_mat3(&matrix).normalize();
        Ok(Rigid { rotation, translation: motion.translation.as_dvec3(), origin: origin.as_dvec3() })
    }

    /// The image of a point (m).
    pub(crate) fn point(&self, x: Vec3) -> Vec3 {
        (self.rotation * (x.as_dvec3() + self.origin) + self.translation - self.origin).as_vec3()
    }

    /// The image of a displacement, velocity or impulse.
    pub(crate) fn vector(&self, v: Vec3) -> Vec3 {
        (self.rotation * v.as_dvec3()).as_vec3()
    }

    /// Maps points with a w component, which is kept.
    pub(crate) fn points4(&self, list: &mut [Vec4]) {
        list.iter_mut().for_each(|x| *x = self.point(x.truncate()).extend(x.w));
    }

    /// Maps vectors with a w component, which is kept.
    pub(crate) fn vectors4(&self, list: &mut [Vec4]) {
        list.iter_mut().for_each(|v| *v = self.vector(v.truncate()).extend(v.w));
    }
}
