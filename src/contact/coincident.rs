//! Pairs of a vertex that lies in a triangle at the start, for example of a sheet that begins in the plane of a table.
//! The vector between the two has no direction, so the side on which the vertex belongs follows from the orientation of
//! the surfaces.

use glam::Vec3A;

use super::detection::Listed;
use super::near::{Near, Start};
use super::surface::Surface;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::vertex_triangle;
use crate::simd::Vector;

/// Distances at the start below this multiple of the thickness count as zero, because rounding alone determines their
/// direction.
pub(super) const TOUCHING: f32 = 1e-4;

/// The near pair of a vertex and a triangle at zero distance; `None` if the triangle has no area.
#[cold]
pub(super) fn coincident(start: &Start<'_>, pair: &Listed, listed: u32) -> Option<Near> {
    let x = pair.corners.map(|vertex| Vector::<f32>::splat(xyz(start.x[vertex as usize]).to_array()));
    let [_, _, free, last] = vertex_triangle(x);
    let normal = facing(start, pair.corners)?.to_array();
    let Listed { corners, thickness, .. } = *pair;
    Some(Near { corners, normal, distance: 0.0, thickness, free, last, listed, acts: true })
}

/// The direction from the triangle to the side on which the vertex belongs.
///
/// Cloth belongs in front of a body. If two layers of cloth face each other, each is in front of the other. If they
/// face the same way, the one whose vertices have the higher indices is in front.
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
