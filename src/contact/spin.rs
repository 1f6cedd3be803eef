//! How mesh colliders turn, vertex by vertex: friction opposes what slides over a surface, not what turns along with it. The closest
//! points of a pair are up to a thickness apart, so a rotation moves them relative to each other.

use glam::{Mat3, Vec3};

use crate::step::plan::MeshBody;

/// The sums over edges from which a rotation follows.
#[derive(Debug, Clone, Copy, Default)]
struct Turning {
    /// The sum of `|m|² - m m^T` (m²), by columns.
    inertia: [Vec3; 3],
    /// The sum of `m x c` (m²).
    moment: Vec3,
}

/// A rotation is not determined if the inertia's determinant is at most this share of the cube of its trace: where all edges are in
/// one line.
const IN_LINE: f32 = 1e-6;

/// The rotation of a body at each of its vertices in a step (rad, along the axis), that of the edges of the triangles there.
///
/// An edge with the midpoint `m` of its vectors at the start and at the end of the step changes by `c = omega x m` if it turns
/// by an angle whose half has the tangent `|omega|/2`. In straight lines from start to end this is how fast it turns halfway.
pub(super) fn spins(body: &MeshBody) -> Vec<Vec3> {
    let [from, to] = [&body.from.positions, &body.to.positions];
    if from == to {
        return vec![Vec3::ZERO; from.len()];
    }
    let mut turning = vec![Turning::default(); from.len()];
    for &[a, b, c] in &body.from.triangles {
        let mut all = Turning::default();
        for [start, end] in [[a, b], [b, c], [c, a]].map(|side| side.map(|vertex| vertex as usize)) {
            let [before, after] = [from[end] - from[start], to[end] - to[start]];
            let middle = 0.5 * (before + after);
            let square = Mat3::from_diagonal(Vec3::splat(middle.length_squared()));
            for (axis, column) in all.inertia.iter_mut().enumerate() {
                *column += square.col(axis) - middle * middle[axis];
            }
            all.moment += middle.cross(after - before);
        }
        for vertex in [a, b, c] {
            let Turning { inertia, moment } = &mut turning[vertex as usize];
            inertia.iter_mut().zip(all.inertia).for_each(|(sum, column)| *sum += column);
            *moment += all.moment;
        }
    }
    turning.iter().map(Turning::rotation).collect()
}

impl Turning {
    fn rotation(&self) -> Vec3 {
        let [x, y, z] = self.inertia;
        let trace = x.x + y.y + z.z;
        if trace <= 0.0 {
            return Vec3::ZERO;
        }
        let scaled = Mat3::from_cols(x / trace, y / trace, z / trace);
        if scaled.determinant() > IN_LINE { scaled.inverse() * (self.moment / trace) } else { Vec3::ZERO }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/contact_spin.rs"]
mod tests;
