//! Explicit springs as forces, for [`Method::Springs`](crate::Method::Springs).

use bytemuck::{Pod, Zeroable};
use glam::Vec3A;

use super::distance::MIN_LENGTH;

/// A spring seen from one of its ends.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Spring {
    pub other: u32,
    /// Rest length (m).
    pub rest: f32,
    /// Stiffness (N/m).
    pub stiffness: f32,
}

/// The force (N) of a spring on one end, `k (l - l0) d / l`, where `d` (m) points from that end to the other.
pub(crate) fn spring_force(d: Vec3A, spring: &Spring) -> Vec3A {
    let length = d.length().max(MIN_LENGTH);
    d * (spring.stiffness * (length - spring.rest) / length)
}
