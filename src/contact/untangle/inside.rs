//! Vertices inside closed mesh colliders, and moving them out.

use std::collections::HashMap;
use std::f32::consts::PI;

use glam::{Vec3, Vec3A};

use super::Tangle;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::vertex_triangle;
use crate::model::mesh::{Mesh, bounds, is_proper};
use crate::simd::Vector;

/// Largest distance (relative to the extent of the body) of vertices that count as one.
const SEAM: f32 = 1e-5;
/// So many vertices of a part are tested, about.
const TESTED: usize = 8;

/// Whether a body has an inside: each side of each triangle is a side of exactly one other triangle, in the opposite
/// direction. Vertices at the same place count as one, because many meshes have seams.
pub(crate) fn is_closed(body: &Mesh) -> bool {
    let names = joined(&body.positions);
    let corners = body.triangles.iter().map(|triangle| triangle.map(|vertex| names[vertex as usize]));
    let proper = corners.filter(is_proper);
    let mut sides: Vec<[u32; 2]> = proper.flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    let mut back: Vec<[u32; 2]> = sides.iter().map(|&[a, b]| [b, a]).collect();
    sides.sort_unstable();
    back.sort_unstable();
    !sides.is_empty() && sides == back && sides.windows(2).all(|two| two[0] != two[1])
}

/// For each vertex the first that is at the same place, within [`SEAM`].
fn joined(positions: &[Vec3]) -> Vec<u32> {
    let [low, high] = bounds(positions);
    let seam = (SEAM * (high - low).max_element()).max(f32::MIN_POSITIVE);
    // Cells that are wider than a seam: what is near to a vertex is mostly in its own cell.
    let cell_of = |x: Vec3| ((x - low) / (4.0 * seam)).floor().to_array().map(|x| x as i32);
    let mut cells: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
    let name_of = |(vertex, &x): (u32, &Vec3)| {
        let [from, to] = [cell_of(x - seam), cell_of(x + seam)];
        let near = (from[0]..=to[0]).flat_map(|i| (from[1]..=to[1]).flat_map(move |j| (from[2]..=to[2]).map(move |k| [i, j, k])));
        let firsts = near.filter_map(|cell| cells.get(&cell)).flatten();
        let first = firsts.copied().filter(|&first| positions[first as usize].distance(x) <= seam).min();
        first.unwrap_or_else(|| {
            cells.entry(cell_of(x)).or_default().push(vertex);
            vertex
        })
    };
    (0..).zip(positions).map(name_of).collect()
}

/// Moves the vertices of connected parts that are inside a body to the nearest points of its surface, and beyond it by the thickness.
/// Returns their number. Nothing may cross, so that a part is inside a body if one of its vertices is: some are tested, because one may
/// touch the surface.
pub(crate) fn leave(tangle: &mut Tangle<'_>, bodies: &[&Mesh]) -> usize {
    let (mut count, thickness) = (0, tangle.thickness);
    let Tangle { x, parts, .. } = tangle;
    for body in bodies {
        let [low, high] = body.bounds();
        let is_inside = |at: Vec3| at.cmpge(low).all() && at.cmple(high).all() && is_inside(body, at.into());
        for part in &*parts {
            let mut tested = part.iter().step_by(part.len().div_ceil(TESTED));
            if !tested.all(|&vertex| is_inside(x[vertex as usize].truncate())) {
                continue;
            }
            for &vertex in part {
                let x = &mut x[vertex as usize];
                if x.w > 0.0 {
                    let surface = nearest(body, xyz(*x));
                    let out = (surface - xyz(*x)).normalize_or_zero();
                    *x = (surface + out * thickness).extend(x.w);
                    count += 1;
                }
            }
        }
    }
    count
}

fn corners(body: &Mesh, triangle: &[u32; 3]) -> [Vec3A; 3] {
    triangle.map(|vertex| Vec3A::from(body.positions[vertex as usize]))
}

/// Whether the winding number of the triangles around a point is one or more (solid angles by van Oosterom and Strackee
/// 1983).
fn is_inside(body: &Mesh, point: Vec3A) -> bool {
    let angle = |triangle: &[u32; 3]| {
        let [a, b, c] = corners(body, triangle).map(|corner| corner - point);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        2.0 * a.dot(b.cross(c)).atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
    };
    let solid_angle: f32 = body.triangles.iter().map(angle).sum();
    solid_angle.abs() > 2.0 * PI
}

/// The point of the surface that is nearest to another point.
fn nearest(body: &Mesh, point: Vec3A) -> Vec3A {
    let on = |triangle: &[u32; 3]| {
        let [a, b, c] = corners(body, triangle);
        let lane = |x: Vec3A| Vector::<f32>::splat(x.to_array());
        let [_, of_a, of_b, of_c] = vertex_triangle([lane(point), lane(a), lane(b), lane(c)]);
        a * -of_a + b * -of_b + c * -of_c
    };
    let points = body.triangles.iter().map(on);
    points.min_by(|a, b| a.distance_squared(point).total_cmp(&b.distance_squared(point))).unwrap_or(Vec3A::ZERO)
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_inside.rs"]
mod tests;
