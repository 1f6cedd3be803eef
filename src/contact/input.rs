//! The input of contact in a substep, and what is known of a vertex in it.

use glam::{Vec3A, Vec4};

use super::common_motion::CommonMotion;
use super::surface::Surface;
use super::workers::Workers;
use crate::kernels::params::Substep;
use crate::simd::Width;
use crate::step::plan::Plan;

/// A substep's start positions (m) and displacements (m).
#[derive(Clone, Copy)]
pub(crate) struct Path<'a> {
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    /// How far (m) each vertex may stray from its path.
    pub margin: &'a [f32],
    /// Whether there is nothing kinematic anywhere, so that only the motion of the cloth's vertices relative to each other matters to
    /// detection.
    pub floats: bool,
    pub workers: Workers<'a>,
}

/// A substep, and what works on it.
#[derive(Clone, Copy)]
pub(crate) struct SubstepContext<'a> {
    pub plan: &'a Plan<'a>,
    pub substep: &'a Substep,
    pub workers: Workers<'a>,
    pub width: Width,
}

/// A vertex of listed pairs.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Vertex {
    pub index: u32,
    /// Position (m); w is the inverse mass (1/kg).
    pub x: Vec4,
    /// Correction of the position (m) that adds no velocity.
    pub push: Vec3A,
    /// Displacement (m) by the predictor, the constraints and the impulses of pairs, without the colliders. Contact with these is a
    /// function of it: computed from what is left of earlier impulses, a collider would keep what it has taken up of an impulse
    /// that is taken back in a later iteration, and return it as a velocity.
    pub free: Vec3A,
    /// Sum of its weights in the pairs that act.
    pub weight: f32,
    /// How far (m) it was about to move relative to the common motion.
    pub travel: f32,
    /// See [`Surface::allowance`].
    pub allowance: f32,
}

impl Vertex {
    /// Whether pairs act on it, and can move it.
    #[inline]
    pub(super) fn acts(&self) -> bool {
        self.x.w != 0.0 && self.weight != 0.0
    }
}

/// The input of contact in a substep.
#[derive(Clone, Copy)]
pub(super) struct ContactInput<'a> {
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    /// Corrections of positions (m) by colliders; empty if there are none.
    pub push: &'a [Vec4],
    /// The length of the longest correction (m).
    pub most_push: f32,
    /// Displacements (m) without the colliders; empty if there are no colliders.
    pub free: &'a [Vec4],
    pub common_motion: CommonMotion,
    /// How far (m) vertices may be carried besides the common motion.
    pub max_carry: f32,
    /// Vertices that are not carried, sorted: see [`KnownCrossings::entangled`](super::crossings::known::KnownCrossings::entangled).
    pub entangled: &'a [u32],
    pub surface: &'a Surface,
    /// Friction coefficients by owner of the pair: see [`Bodies::friction`](super::bodies::Bodies).
    pub friction: &'a [f32],
    pub context: SubstepContext<'a>,
}
