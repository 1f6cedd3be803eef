//! Normals and dimensions of triangle meshes.

use cloth_deformer::glam::Vec3;

/// The lowest and highest corner of the bounding box of some points.
pub(super) fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)))
}

/// The length of the longest edge (m).
pub(super) fn longest_edge(positions: &[Vec3], triangles: &[[u32; 3]]) -> f32 {
    let at = |vertex: u32| positions[vertex as usize];
    triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).map(|(i, j)| at(i).distance(at(j))).fold(0.0, f32::max)
}

/// The normal of a triangle; its length is twice the area.
pub(super) fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

/// Vertex normals: sums of the normals of the vertices' triangles, weighted by area, not normalized.
pub(super) fn vertex_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles.iter().map(|triangle| triangle.map(|vertex| vertex as usize)) {
        let flat = normal(triangle.map(|vertex| positions[vertex]));
        for vertex in triangle {
            normals[vertex] += flat;
        }
    }
    normals
}

/// The vectors at a triangle's corners, interpolated at `point` and normalized.
pub(super) fn interpolate(point: Vec3, [a, b, c]: [Vec3; 3], vectors: [Vec3; 3]) -> Vec3 {
    let flat = normal([a, b, c]);
    let weight = |from: Vec3, to: Vec3| (to - from).cross(point - from).dot(flat);
    let weights = [weight(b, c), weight(c, a), weight(a, b)];
    (0..3)
        .map(|corner| weights[corner] * vectors[corner].normalize_or_zero())
        .sum::<Vec3>()
        .normalize_or(flat.normalize_or_zero())
}
