//! Which edges a sweep visits twice: those of closed shells, and the diagonals of tubes.
//!
//! A closed shell is a connected part of a cloth that is closed or bulges, such as a ball, a cushion, or half a ball.
//! Flat cloth, and everything that is rolled or folded from it, gives way to compression without stretch. A shell cannot:
//! nearly all of its motions stretch edges. One sweep in a fixed order is not symmetric, and among stretching motions of
//! nearly the same frequency that pumps energy into the cloth
//! ([`step::coefficients`](crate::step::coefficients)). So the sweep visits the edges of shells a second time, in reverse
//! order.
//!
//! An open tube, or anything else that is open and can be cut without falling apart, is pumped in the same way, slowly, if it is
//! made of quads that are all cut along the same diagonal. There it is enough to visit the diagonals before the other edges and
//! again after them: the others are nearly at right angles, so that their order does not matter, and the sweep is all but
//! symmetric (`benches/results/quality.md`).

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec3, Vec3};

use crate::model::disjoint_sets::DisjointSets;
use crate::model::link::Visits;
use crate::model::mesh::{EdgeIndex, triangles_at};

/// Total curvature above which an open part counts as a shell, a quarter of a ball's; below 0 for one without a border.
const BULGES: f64 = PI;

/// An edge is a diagonal if it is longer than all others of its triangles by this factor.
const LONGER: f64 = 1.05;

/// A part is made of quads if at least one in so many of its edges is a diagonal. In a grid that is one in three, or one in five if the
/// vertices have been moved by a third of an edge. Garments from triangles that no grid underlies have one in twelve.
const QUADS: i64 = 6;

/// How often a sweep visits each of the `edges`, which are those of `index`; empty if all of them once.
///
/// The total curvature of a part is the sum over its inner vertices of `2 pi` less the angles around them (Gauss and
/// Bonnet): `4 pi` for a ball, `2 pi` for half of one, 0 for a tube and for any sheet however it is folded, less for a
/// shirt, 0 for a ring without a border, and very little for a sheet whose triangles occur twice, for its back. Its Euler
/// characteristic, `vertices - edges + triangles`, is 1 for a sheet, 0 for a tube and -2 for a shirt.
pub(crate) fn visits(positions: &[Vec3], triangles: &[[u32; 3]], edges: &[[u32; 2]], index: &EdgeIndex) -> Vec<Visits> {
    let part = DisjointSets::parts(positions.len(), edges.iter().copied());
    let of_part = |vertex: u32| part[vertex as usize] as usize;
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
    let mut characteristic = vec![0_i64; positions.len()];
    for vertex in 0..positions.len() as u32 {
        characteristic[of_part(vertex)] += 1;
        if is_border[vertex as usize] || angle[vertex as usize] == 0.0 {
            is_open[of_part(vertex)] = true;
        } else {
            curvature[of_part(vertex)] += TAU - angle[vertex as usize];
        }
    }
    edges.iter().for_each(|ends| characteristic[of_part(ends[0])] -= 1);
    triangles.iter().for_each(|triangle| characteristic[of_part(triangle[0])] += 1);
    let is_shell = |part: usize| curvature[part] > if is_open[part] { BULGES } else { -BULGES };
    let is_tube = |part: usize| characteristic[part] <= 0 && !is_shell(part);
    let has_diagonal = |(edge, ends): (usize, &[u32; 2])| {
        is_tube(of_part(ends[0])) && is_diagonal(*ends, positions, triangles, beside.of(edge as u32))
    };
    let is_diagonal: Vec<bool> = edges.iter().enumerate().map(has_diagonal).collect();
    // Edges less the multiple of diagonals that makes a part one of quads.
    let mut lacking = vec![0_i64; positions.len()];
    for (ends, &is_diagonal) in edges.iter().zip(&is_diagonal) {
        lacking[of_part(ends[0])] += if is_diagonal { 1 - QUADS } else { 1 };
    }
    let visits_of = |(ends, &is_diagonal): (&[u32; 2], &bool)| match of_part(ends[0]) {
        part if is_shell(part) => Visits::ThereAndBack,
        part if is_diagonal && lacking[part] <= 0 => Visits::FirstAndLast,
        _ => Visits::Once,
    };
    let visits: Vec<Visits> = edges.iter().zip(&is_diagonal).map(visits_of).collect();
    if visits.iter().all(|&visits| visits == Visits::Once) { Vec::new() } else { visits }
}

/// Whether an edge is the longest by far of the triangles `beside` it, which are two or more.
fn is_diagonal(ends: [u32; 2], positions: &[Vec3], triangles: &[[u32; 3]], beside: &[u32]) -> bool {
    let length = |[a, b]: [u32; 2]| positions[a as usize].as_dvec3().distance(positions[b as usize].as_dvec3());
    let own = length(ends);
    let is_longest = |&triangle: &u32| {
        let [a, b, c] = triangles[triangle as usize];
        let others = [[a, b], [b, c], [c, a]].into_iter().filter(|side| !side.iter().all(|vertex| ends.contains(vertex)));
        others.map(length).all(|other| own > LONGER * other)
    };
    beside.len() > 1 && beside.iter().all(is_longest)
}

/// The angle between two sides of a triangle. It is a right one if either has no length, so that the angles of a triangle
/// of which two corners coincide add up, too.
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    if a == DVec3::ZERO || b == DVec3::ZERO { FRAC_PI_2 } else { a.cross(b).length().atan2(a.dot(b)) }
}

#[cfg(test)]
#[path = "../../tests/unit/model_shells.rs"]
pub(crate) mod tests;
