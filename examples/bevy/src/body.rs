//! A body of capsules that walks in a circle: where its limbs and its collar are at a time.

use std::array::from_fn;
use std::f32::consts::{PI, TAU};

use cloth_deformer::Collider;
use cloth_deformer::glam::{Affine3A, Quat, Vec3};

/// Radius (m) of the circle, and speed along it (m/s).
const CIRCLE: f32 = 2.4;
const SPEED: f32 = 1.5;
/// Strides a second, of two steps each.
const STRIDES: f32 = 0.95;
/// Length of a thigh and of a shin (m).
const LEG: f32 = 0.44;

/// Number of limbs.
pub(crate) const LIMBS: usize = 10;
/// Radii of the limbs (m).
pub(crate) const RADII: [f32; LIMBS] = [0.135, 0.08, 0.05, 0.12, 0.08, 0.055, 0.045, 0.08, 0.055, 0.045];
/// The limb that is a ball.
pub(crate) const HEAD: usize = 3;

/// The body at a time: it looks along -z of its own space, y is up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    /// From its own space to the world.
    pub(crate) root: Affine3A,
    /// The ends of each limb's axis in the world (m).
    pub(crate) limbs: [[Vec3; 2]; LIMBS],
}

impl Pose {
    /// After `time` (s), when its circle is at `place`.
    pub(crate) fn at(time: f32, place: Affine3A) -> Pose {
        let angle = SPEED / CIRCLE * time;
        let phase = TAU * STRIDES * time;
        let up_and_down = -0.02 * (1.0 - (2.0 * phase).cos());
        let turn = Affine3A::from_quat(Quat::from_rotation_y(angle));
        let root = place * turn * Affine3A::from_translation(Vec3::new(CIRCLE, up_and_down, 0.0));
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let swung = |from: Vec3, length: f32, angle: f32| from + length * Vec3::new(0.0, -angle.cos(), -angle.sin());
        // A leg swings forward half a stride after the other, its knee bent on the way; an arm goes with the other side's leg.
        let side = |x: f32, phase: f32| {
            let thigh = 0.45 * phase.sin();
            let shin = thigh - 0.12 - 0.55 * (0.5 + 0.5 * (phase + 0.9).cos()).powi(2);
            let hip = at(0.10 * x, 0.92, 0.0);
            let knee = swung(hip, LEG, thigh);
            let shoulder = at(0.215 * x, 1.41, 0.0);
            let hand = swung(shoulder, 0.58, 0.08 - 0.4 * phase.sin()) + at(0.06 * x, 0.0, 0.0);
            [[hip, knee], [knee, swung(knee, LEG, shin)], [shoulder, hand]]
        };
        let (left, right) = (side(1.0, phase), side(-1.0, phase + PI));
        let chest = [at(0.0, 1.04, 0.0), at(0.0, 1.34, 0.0)];
        let shoulders = [at(-0.165, 1.43, 0.0), at(0.165, 1.43, 0.0)];
        let neck = [at(0.0, 1.43, 0.0), at(0.0, 1.6, -0.01)];
        let head = [at(0.0, 1.70, -0.02); 2];
        let limbs = [chest, shoulders, neck, head, left[0], left[1], left[2], right[0], right[1], right[2]];
        Pose { root, limbs: limbs.map(|ends| ends.map(|end| root.transform_point3(end))) }
    }

    /// The same, put elsewhere.
    pub(crate) fn moved(&self, motion: Affine3A) -> Pose {
        Pose { root: motion * self.root, limbs: self.limbs.map(|ends| ends.map(|end| motion.transform_point3(end))) }
    }

    /// A part of the way to a later pose: everything goes straight, as the cloth between two steps does.
    pub(crate) fn toward(&self, later: &Pose, part: f32) -> Pose {
        let limbs = from_fn(|limb| from_fn(|end| self.limbs[limb][end].lerp(later.limbs[limb][end], part)));
        let turn = Quat::from_mat3a(&self.root.matrix3).slerp(Quat::from_mat3a(&later.root.matrix3), part);
        let at = self.root.translation.lerp(later.root.translation, part);
        Pose { root: Affine3A::from_rotation_translation(turn, at.into()), limbs }
    }

    /// What the cloth meets.
    pub(crate) fn colliders(&self) -> Vec<Collider> {
        let solid = |limb: usize, a: Vec3, b: Vec3| match limb {
            HEAD => Collider::sphere(a, RADII[limb]),
            _ => Collider::capsule(a, b, RADII[limb]),
        };
        self.limbs.iter().enumerate().map(|(limb, &[a, b])| solid(limb, a, b)).collect()
    }
}
