//! Where a vertex is on its way to if nothing holds it, and where a pin is led.

use std::ops::{Add, Mul};

use bytemuck::{Pod, Zeroable};
use glam::{Vec3A, Vec4};

use super::params::Substep;

/// A pinned vertex on its way through a step, in local coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Pin {
    pub origin: [f32; 3],
    pub vertex: u32,
    pub goal: [f32; 3],
    pub padding: u32,
}

/// Displacement (m) predicted from the last one and the ambient acceleration: leapfrog, exact for linear drag.
///
/// `carry` is [`Substep::carry`], `fall` the acceleration times [`Substep::gain`] (m).
#[inline(always)]
pub(crate) fn predict_displacement<V: Mul<Output = V> + Add<Output = V>>(p: V, carry: V, fall: V) -> V {
    p * carry + fall
}

/// Displacement (m) of a pin at `x` (m) to where it is led by the end of the substep.
pub(crate) fn pin_displacement(pin: &Pin, x: Vec3A, substep: &Substep) -> Vec3A {
    let (origin, goal) = (Vec3A::from(pin.origin), Vec3A::from(pin.goal));
    origin + (goal - origin) * substep.end - x
}

/// The xyz of a vertex stored with a fourth number.
pub(crate) fn xyz(v: Vec4) -> Vec3A {
    Vec3A::from_vec4(v)
}
