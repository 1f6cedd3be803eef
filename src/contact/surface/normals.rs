//! Bounds of the normals of triangles, from which follows that cloth is not folded over.

use glam::Vec3A;

/// Cosine of the angle of a cone. If the normals of connected cloth are within such a cone, it is not folded over.
pub(crate) const CONE_COSINE: f32 = 0.64;

/// Whether all unit vectors within bounds are in one cone of [`CONE_COSINE`].
pub(crate) fn in_one_cone([low, high]: [Vec3A; 2]) -> bool {
    let axis = low + high;
    let (a, b) = (low * axis, high * axis);
    let least = a.min(b);
    let least = least.x + least.y + least.z;
    least > 0.0 && least * least > CONE_COSINE * CONE_COSINE * axis.length_squared()
}

/// Bounds of the unit normals of a triangle that moves from `x` to `end` (m), each vertex along a straight path from which it
/// may stray by the `margin` (m).
///
/// Its normal times twice its area is a quadratic Bézier curve in time. So on the whole path the normal is in each cone that
/// contains the three control vectors (Tang et al. 2009, "ICCD: Interactive Continuous Collision Detection between Deformable
/// Models Using Connectivity-Based Culling"). The bounds ignore straying, which tilts the triangle by no more than a cone of
/// [`CONE_COSINE`] leaves up to a right angle; if it may tilt it farther, they contain all directions.
pub(crate) fn normals_on_path(x: [Vec3A; 3], end: [Vec3A; 3], margin: f32) -> [Vec3A; 2] {
    let sides = |[a, b, c]: [Vec3A; 3]| [b - a, c - a, c - b];
    let (first, last) = (sides(x), sides(end));
    let (before, after) = (first[0].cross(first[1]), last[0].cross(last[1]));
    let between = (before + after - (last[0] - first[0]).cross(last[1] - first[1])) * 0.5;
    let longest = first.into_iter().chain(last).map(Vec3A::length_squared).fold(0.0, f32::max);
    let [one, two, three] = [before, between, after].map(Vec3A::normalize_or_zero);
    // The area along the first normal is never less than the least of the control vectors'.
    let twice_area = before.length().min(one.dot(between)).min(one.dot(after));
    if may_tilt(twice_area, longest.sqrt(), margin) {
        return [Vec3A::NEG_ONE, Vec3A::ONE];
    }
    [one.min(two).min(three), one.max(two).max(three)]
}

/// Whether a triangle, given by twice its area (m²) and its `longest` side (m), may tilt by more than a cone ([`CONE_COSINE`])
/// leaves up to a right angle, if each vertex strays so far (m): the sine of that angle is the cosine of the cone's, and that
/// of the tilt is twice the straying over the least height.
fn may_tilt(twice_area: f32, longest: f32, margin: f32) -> bool {
    2.0 * margin * longest >= CONE_COSINE * twice_area
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_normals.rs"]
mod tests;
