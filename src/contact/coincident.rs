//! Starts where a vertex lies in a triangle, as where a sheet begins in the plane of a table: the vector between the two has no direction, so the
//! side that the vertex belongs on is told from the way that surfaces face.

use glam::Vec3A;

use super::detection::Listed;
use super::near::{Near, Start};
use super::surface::Surface;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::vertex_triangle;
use crate::simd::Vector;

/// What is this near (m per m of thickness) at a start is at no distance: rounding alone decides on its direction.
pub(super) const TOUCHING: f32 = 1e-4;

/// The near pair of a vertex and a triangle that are at no distance; none if the triangle has no area.
#[cold]
pub(super) fn coincident(start: &Start<'_>, pair: &Listed, listed: u32) -> Option<Near> {
    let x = pair.corners.map(|vertex| Vector::<f32>::splat(xyz(start.x[vertex as usize]).to_array()));
    let [_, _, free, last] = vertex_triangle(x);
    let normal = facing(start, pair.corners)?.to_array();
    let Listed { corners, thickness, .. } = *pair;
    Some(Near { corners, normal, distance: 0.0, thickness, free, last, listed, acts: true })
}

/// From the triangle to the vertex, as it is to be.
///
/// Cloth belongs in front of a body. Of two layers of cloth that face one another each is in front of the other; of two that face the same way the
/// one whose vertices have the higher numbers is.
fn facing(start: &Start<'_>, [vertex, a, b, c]: [u32; 4]) -> Option<Vec3A> {
    let Surface { owner, triangles, triangle_at, .. } = start.surface;
    let at = |vertex: u32| xyz(start.x[vertex as usize]);
    let normal = |[a, b, c]: [u32; 3]| (at(b) - at(a)).cross(at(c) - at(a)).try_normalize();
    let of_triangle = normal([a, b, c])?;
    let of_vertex = || normal(*triangles.get(triangle_at[vertex as usize] as usize)?);
    match [owner[vertex as usize], owner[a as usize]] {
        [0, 0] => {
            let same = of_vertex().is_some_and(|of_vertex| of_vertex.dot(of_triangle) > 0.0);
            Some(if same && vertex < a { -of_triangle } else { of_triangle })
        }
        [0, _] => Some(of_triangle),
        _ => Some(-of_vertex()?),
    }
}
