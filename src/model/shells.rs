//! Closed shells: connected parts of a cloth that are closed or bulge, such as a ball, a cushion, or half a ball.
//!
//! Flat cloth, and everything that is rolled or folded from it, gives way to compression without stretch. A shell cannot:
//! nearly all of its motions stretch edges. One sweep in a fixed order is not symmetric, and among stretching motions of
//! nearly the same frequency that pumps energy into the cloth
//! ([`step::coefficients`](crate::step::coefficients)). So the sweep visits the edges of shells a second time, in reverse
//! order.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec3, Vec3};

use crate::model::disjoint_sets::DisjointSets;
use crate::model::mesh::{EdgeIndex, triangles_at};

/// Total curvature above which an open part counts as a shell, a quarter of a ball's; below 0 for one without a border.
const BULGES: f64 = PI;

/// Tells for each vertex whether it is part of a closed shell; empty if none is. `edges` are those of `index`.
///
/// The total curvature of a part is the sum over its inner vertices of `2 pi` less the angles around them (Gauss and
/// Bonnet): `4 pi` for a ball, `2 pi` for half of one, 0 for a tube and for any sheet however it is folded, less for a
/// shirt, 0 for a ring without a border, and very little for a sheet whose triangles occur twice, for its back.
pub(crate) fn in_shells(positions: &[Vec3], triangles: &[[u32; 3]], edges: &[[u32; 2]], index: &EdgeIndex) -> Vec<bool> {
    let part = DisjointSets::parts(positions.len(), edges.iter().copied());
    let mut angle = vec![0.0; positions.len()];
    for &triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize].as_dvec3());
        let angles = [[a, b, c], [b, c, a], [c, a, b]].map(|[x, next, last]| angle_between(next - x, last - x));
        triangle.iter().zip(angles).for_each(|(&vertex, corner)| angle[vertex as usize] += corner);
    }
    let mut is_border = vec![false; positions.len()];
    let beside = triangles_at(edges, triangles, index);
    for (ends, _) in edges.iter().zip(0..).filter(|&(_, edge)| beside.of(edge).len() == 1) {
        ends.iter().for_each(|&vertex| is_border[vertex as usize] = true);
    }
    let (mut curvature, mut is_open) = (vec![0.0; positions.len()], vec![false; positions.len()]);
    for (vertex, &part) in part.iter().enumerate() {
        match is_border[vertex] || angle[vertex] == 0.0 {
            true => is_open[part as usize] = true,
            false => curvature[part as usize] += TAU - angle[vertex],
        }
    }
    let is_shell = |&part: &u32| curvature[part as usize] > if is_open[part as usize] { BULGES } else { -BULGES };
    let in_shells: Vec<bool> = part.iter().map(is_shell).collect();
    if in_shells.contains(&true) { in_shells } else { Vec::new() }
}

/// The angle between two sides of a triangle. It is a right one if either has no length, so that the angles of a triangle
/// of which two corners coincide add up, too.
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    if a == DVec3::ZERO || b == DVec3::ZERO { FRAC_PI_2 } else { a.cross(b).length().atan2(a.dot(b)) }
}

#[cfg(test)]
#[path = "../../tests/unit/model_shells.rs"]
pub(crate) mod tests;
