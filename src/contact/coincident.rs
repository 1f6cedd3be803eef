//! Pairs of a vertex that lies in a triangle at the start, for example of a sheet that begins in the plane of a table.
//! The vector between the two has no direction, so the side on which the vertex belongs follows from the orientation of
//! the surfaces.

use glam::{Vec3A, Vec4};

use super::surface::Surface;
use crate::kernels::integrate::xyz;
use crate::kernels::pair::vertex_triangle;
use crate::simd::Vector;

/// Distances at the start below this multiple of the thickness count as zero, because rounding alone determines their
/// direction.
pub(super) const TOUCHING: f32 = 1e-4;

/// The normal and the two weights (`Kind::weights`) of a vertex and a triangle at zero distance;
/// `None` if the triangle has no area.
#[cold]
pub(super) fn coincident(surface: &Surface, x: &[Vec4], corners: [u32; 4]) -> Option<([f32; 3], [f32; 2])> {
    let at = corners.map(|vertex| Vector::<f32>::splat(xyz(x[vertex as usize]).to_array()));
    let [_, _, free, last] = vertex_triangle(at);
    Some((facing(surface, x, corners)?.to_array(), [free, last]))
}

/// The direction from the triangle to the side on which the vertex belongs.
///
/// Cloth belongs in front of a body. If two layers of cloth face each other, each is in front of the other. If they
/// face the same way, the one whose vertices have the higher indices is in front.
fn facing(surface: &Surface, x: &[Vec4], [vertex, a, b, c]: [u32; 4]) -> Option<Vec3A> {
    let Surface { owner, triangles, triangle_at, .. } = surface;
    let at = |vertex: u32| xyz(x[vertex as usize]);
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
