//! Prediction of a vertex's displacement without constraints, and of a pin's prescribed one.

use std::ops::{Add, Mul};

use bytemuck::{Pod, Zeroable};
use glam::{Vec3A, Vec4};

use super::params::Substep;

/// A pin that follows a target, with its positions at the step's start and end (m, local coordinates).
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Pin {
    pub origin: [f32; 3],
    pub vertex: u32,
    pub goal: [f32; 3],
    pub padding: u32,
}

/// The displacement (m) predicted from the last one and the ambient acceleration, by leapfrog; exact for linear drag.
///
/// `carry` is [`Substep::carry`], and `fall` is [`Substep::fall`].
#[inline(always)]
pub(crate) fn predict_displacement<V: Mul<Output = V> + Add<Output = V>>(p: V, carry: V, fall: V) -> V {
    p * carry + fall
}

/// The displacement (m) of a pin at `x` (m) to its prescribed position at the end of the substep.
pub(crate) fn pin_displacement(pin: &Pin, x: Vec3A, substep: &Substep) -> Vec3A {
    let (origin, goal) = (Vec3A::from(pin.origin), Vec3A::from(pin.goal));
    origin + (goal - origin) * substep.end - x
}

/// The xyz components of a vector whose w component holds something else.
pub(crate) fn xyz(v: Vec4) -> Vec3A {
    Vec3A::from_vec4(v)
}
