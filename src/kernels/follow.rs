//! A vertex of a render mesh that follows the triangle of the cloth to which it is bound.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// A vertex of the render mesh, as `stages/follow.wgsl` reads it, too.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct BoundVertex {
    pub corners: [u32; 3],
    /// The height (m) along the cloth's normal.
    pub height: f32,
    /// Of the normals of the corners; all 0 for the triangle's own normal.
    pub normal_weights: [f32; 3],
    /// Weight of the second corner's position. The weights of all three sum to 1.
    pub of_b: f32,
    /// The render mesh's normal at rest: its products with the sides from the first corner to the others (m), and with the cloth's normal.
    pub normal: [f32; 3],
    /// Weight of the third corner's position.
    pub of_c: f32,
}

/// The position (m) of a vertex without its height, from those of the corners.
pub(crate) fn foot(vertex: &BoundVertex, [a, b, c]: [Vec3; 3]) -> Vec3 {
    // Relative to a corner, so that rounding is as fine far from the origin as it can be.
    a + (b - a) * vertex.of_b + (c - a) * vertex.of_c
}

/// The cloth's unit normal at a vertex, from positions (m) and normals of the corners; 0 where there is no area.
pub(crate) fn cloth_normal(vertex: &BoundVertex, [a, b, c]: [Vec3; 3], normals: [Vec3; 3]) -> Vec3 {
    let [of_a, of_b, of_c] = vertex.normal_weights;
    let smooth = normals[0] * of_a + normals[1] * of_b + normals[2] * of_c;
    smooth.try_normalize().unwrap_or_else(|| (b - a).cross(c - a).normalize_or_zero())
}

/// The render mesh's unit normal at a vertex, from the positions (m) of the corners and the cloth's normal there; 0 if it has none.
///
/// Its products with the sides and the cloth's normal are those at rest, up to a common factor, so that what was perpendicular to it stays so.
pub(crate) fn render_normal(vertex: &BoundVertex, [a, b, c]: [Vec3; 3], cloth_normal: Vec3) -> Vec3 {
    let [of_b, of_c, up] = vertex.normal;
    let (b, c) = (b - a, c - a);
    let area = b.cross(c);
    let sum = c.cross(cloth_normal) * of_b + cloth_normal.cross(b) * of_c + area * up;
    (sum * area.dot(cloth_normal).signum()).normalize_or_zero()
}
