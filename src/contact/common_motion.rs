//! The common motion of the cloth in a substep, relative to which displacements are truncated.

#[cfg(feature = "gpu")]
use glam::Vec4;
use glam::{DMat3, DVec3, Mat3A, Vec3A};

/// Range of the displacements of kinematic vertices, in units of the thickness, above which it is tested whether it turns.
const TURNS: f32 = 1e-3;
/// It moves rigidly if no more than this share of that range is left besides the fitted motion.
const LEFT: f32 = 0.5;
/// So many points, at least, are fitted of those that there are.
const FITTED: usize = 64;
/// Most steps to find a rotation, and the angle (rad) below which a step is the last: the next would be its square.
const STEPS: usize = 4;
const SMALL: f64 = 1e-3;

/// A rigid motion by less than half a turn, which keeps all distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CommonMotion {
    /// The displacement (m) of the center.
    by: Vec3A,
    /// The rotation about it less the identity.
    turn: Mat3A,
    center: Vec3A,
}

impl Default for CommonMotion {
    /// No motion. (A matrix is the identity by default.)
    fn default() -> CommonMotion {
        CommonMotion::of(Vec3A::ZERO)
    }
}

impl CommonMotion {
    /// A translation (m).
    pub(super) fn of(by: Vec3A) -> CommonMotion {
        CommonMotion { by, turn: Mat3A::ZERO, center: Vec3A::ZERO }
    }

    /// The displacement (m) of what is at `x` (m).
    #[inline]
    pub(super) fn at(&self, x: Vec3A) -> Vec3A {
        self.by + self.turn * (x - self.center)
    }

    /// A displacement (m) as it appears in what moves: turned back.
    #[inline]
    pub(super) fn back(&self, by: Vec3A) -> Vec3A {
        by + self.turn.transpose() * by
    }

    /// The common motion of kinematic vertices that turn: those of pins and bodies, given by places and displacements (m).
    /// `None` if they do not turn as one, or if what is left of their motion has a range of more than the thickness (m).
    pub(super) fn of_kinematic(kinematic: impl Iterator<Item = (Vec3A, Vec3A)> + Clone, thickness: f32) -> Option<CommonMotion> {
        let nothing = [Vec3A::INFINITY, Vec3A::NEG_INFINITY];
        let with = |[low, high]: [Vec3A; 2], by: Vec3A| [low.min(by), high.max(by)];
        let (count, [low, high]) = kinematic.clone().fold((0, nothing), |(count, range), (_, u)| (count + 1, with(range, u)));
        let apart = low.distance(high);
        // Also false if there are none.
        let may_turn = (high - low).max_element() > TURNS * thickness;
        if !may_turn {
            return None;
        }
        let turning = CommonMotion::fitted(kinematic.clone(), count);
        let [low, high] = kinematic.fold(nothing, |range, (x, u)| with(range, u - turning.at(x)));
        let by = turning.by + (low + high) * 0.5;
        let left = low.distance(high);
        (left < thickness && left < LEFT * apart).then_some(CommonMotion { by, ..turning })
    }

    /// The rotation less the identity, by columns, the center (m) and its displacement (m); w is unused.
    #[cfg(feature = "gpu")]
    pub(super) fn columns(&self) -> [Vec4; 5] {
        let CommonMotion { turn, center, by } = self;
        [turn.x_axis, turn.y_axis, turn.z_axis, *center, *by].map(|column| column.extend(0.0))
    }

    /// The rigid motion that fits `count` points, of which at least [`FITTED`] are used, each at the same distance from the
    /// last. They are visited once.
    fn fitted(points: impl Iterator<Item = (Vec3A, Vec3A)>, count: usize) -> CommonMotion {
        let mut chosen = [(Vec3A::ZERO, Vec3A::ZERO); 2 * FITTED];
        let (each, mut next, mut taken) = ((count / FITTED).max(1), 0, 0);
        for (index, point) in points.enumerate() {
            if index == next {
                (chosen[taken], next, taken) = (point, next + each, taken + 1);
            }
        }
        CommonMotion::turning(chosen[..taken].iter().copied())
    }

    /// The rigid motion that fits the motion of some points; each has a place and a displacement (m).
    ///
    /// The rotation is found by steps of least squares, each of them linear in the angle; for points that move rigidly these
    /// converge to their rotation.
    fn turning(points: impl Iterator<Item = (Vec3A, Vec3A)> + Clone) -> CommonMotion {
        let (mut place, mut by, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for (x, u) in points.clone() {
            (place, by, count) = (place + x.as_dvec3(), by + u.as_dvec3(), count + 1.0);
        }
        let (center, by) = (place / count, by / count);
        let mut turn = DMat3::IDENTITY;
        for _ in 0..STEPS {
            let (mut inertia, mut momentum) = (DMat3::ZERO, DVec3::ZERO);
            for (x, u) in points.clone() {
                let from = x.as_dvec3() - center;
                let (r, to) = (turn * from, from + u.as_dvec3() - by);
                inertia += DMat3::from_diagonal(DVec3::splat(r.length_squared())) - DMat3::from_cols(r * r.x, r * r.y, r * r.z);
                momentum += r.cross(to);
            }
            // Points in a line do not tell how they turn about it.
            let trace = inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z;
            let step = (inertia + DMat3::from_diagonal(DVec3::splat(1e-9 * trace + 1e-30))).inverse() * momentum;
            let axis = step.try_normalize().unwrap_or(DVec3::X);
            turn = DMat3::from_axis_angle(axis, step.length()) * turn;
            if step.length() < SMALL {
                break;
            }
        }
        let [x, y, z] = (turn - DMat3::IDENTITY).to_cols_array_2d().map(|column| DVec3::from_array(column).as_vec3a());
        CommonMotion { by: by.as_vec3a(), turn: Mat3A::from_cols(x, y, z), center: center.as_vec3a() }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/contact_common_motion.rs"]
mod tests;
