//! 3-vectors with one number per lane in each component.

use std::ops::{Add, Mul, Sub};

use super::Lanes;

/// One 3-vector per lane, as a structure of arrays: all x, all y, all z.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Vector<L> {
    pub x: L,
    pub y: L,
    pub z: L,
}

impl<L: Lanes> Vector<L> {
    #[inline(always)]
    pub(crate) fn new(x: L, y: L, z: L) -> Vector<L> {
        Vector { x, y, z }
    }

    /// The same vector in every lane.
    #[inline(always)]
    pub(crate) fn splat([x, y, z]: [f32; 3]) -> Vector<L> {
        Vector { x: L::splat(x), y: L::splat(y), z: L::splat(z) }
    }

    #[inline(always)]
    pub(crate) fn zero() -> Vector<L> {
        Vector::splat([0.0; 3])
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Vector<L>) -> L {
        self.z.mul_add(other.z, self.y.mul_add(other.y, self.x * other.x))
    }

    #[inline(always)]
    pub(crate) fn length(self) -> L {
        self.dot(self).sqrt()
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Vector<L> {
        Vector { x: self.x.abs(), y: self.y.abs(), z: self.z.abs() }
    }

    /// Times the inverse of a number.
    #[inline(always)]
    pub(crate) fn over(self, by: L) -> Vector<L> {
        self * (L::splat(1.0) / by)
    }

    /// The products of the components.
    #[inline(always)]
    pub(crate) fn times(self, other: Vector<L>) -> Vector<L> {
        Vector { x: self.x * other.x, y: self.y * other.y, z: self.z * other.z }
    }

    #[inline(always)]
    pub(crate) fn cross(self, other: Vector<L>) -> Vector<L> {
        Vector {
            x: self.z.neg_mul_add(other.y, self.y * other.z),
            y: self.x.neg_mul_add(other.z, self.z * other.x),
            z: self.y.neg_mul_add(other.x, self.x * other.y),
        }
    }

    /// `self * by + plus`.
    #[inline(always)]
    pub(crate) fn mul_add(self, by: L, plus: Vector<L>) -> Vector<L> {
        Vector { x: self.x.mul_add(by, plus.x), y: self.y.mul_add(by, plus.y), z: self.z.mul_add(by, plus.z) }
    }

    /// `yes` in the lanes of the mask, `no` in the others.
    #[inline(always)]
    pub(crate) fn select(mask: L::Mask, yes: Vector<L>, no: Vector<L>) -> Vector<L> {
        Vector { x: L::select(mask, yes.x, no.x), y: L::select(mask, yes.y, no.y), z: L::select(mask, yes.z, no.z) }
    }
}

impl<L: Lanes> Add for Vector<L> {
    type Output = Vector<L>;
    #[inline(always)]
    fn add(self, other: Vector<L>) -> Vector<L> {
        Vector { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl<L: Lanes> Sub for Vector<L> {
    type Output = Vector<L>;
    #[inline(always)]
    fn sub(self, other: Vector<L>) -> Vector<L> {
        Vector { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl<L: Lanes> Mul<L> for Vector<L> {
    type Output = Vector<L>;
    #[inline(always)]
    fn mul(self, by: L) -> Vector<L> {
        Vector { x: self.x * by, y: self.y * by, z: self.z * by }
    }
}
