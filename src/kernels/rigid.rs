//! A rigid motion of all that a cloth has: points and vectors in its own coordinates.

use glam::{Affine3A, DMat3, DQuat, DVec3, Vec3, Vec4};

/// How far from a rotation a matrix may be by rounding: the largest entry of `R^T R - 1`.
const ROUNDING: f64 = 1e-3;

/// A rotation, then a translation (m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rigid {
    rotation: DQuat,
    translation: DVec3,
    /// Where the cloth's own coordinates begin (m).
    origin: DVec3,
}

impl Rigid {
    /// Of a cloth whose coordinates begin at `origin`; what is wrong with a motion that is not rigid.
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
        // What rounding left in the matrix would add up.
        let rotation = DQuat::from_mat3(&matrix).normalize();
        Ok(Rigid { rotation, translation: motion.translation.as_dvec3(), origin: origin.as_dvec3() })
    }

    /// Where a point goes (m).
    pub(crate) fn point(&self, x: Vec3) -> Vec3 {
        (self.rotation * (x.as_dvec3() + self.origin) + self.translation - self.origin).as_vec3()
    }

    /// How a displacement, a velocity or an impulse turns.
    pub(crate) fn vector(&self, v: Vec3) -> Vec3 {
        (self.rotation * v.as_dvec3()).as_vec3()
    }

    /// The same of points and of vectors that have a fourth number, which stays.
    pub(crate) fn points4(&self, list: &mut [Vec4]) {
        list.iter_mut().for_each(|x| *x = self.point(x.truncate()).extend(x.w));
    }

    pub(crate) fn vectors4(&self, list: &mut [Vec4]) {
        list.iter_mut().for_each(|v| *v = self.vector(v.truncate()).extend(v.w));
    }
}
