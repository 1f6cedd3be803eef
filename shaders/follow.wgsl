// A vertex of a render mesh that follows the triangle of the cloth to which it is bound.

struct BoundVertex {
    corners: vec3u,
    // The height (m) along the cloth's normal.
    height: f32,
    // Of the normals of the corners; all 0 for the triangle's own normal.
    normal_weights: vec3f,
    // Weight of the second corner's position. The weights of all three sum to 1.
    of_b: f32,
    // The render mesh's normal at rest: its products with the sides from the first corner to the others (m), and with the cloth's normal.
    normal: vec3f,
    // Weight of the third corner's position.
    of_c: f32,
}

// The position (m) of a vertex without its height, from those of the corners.
fn foot(vertex: BoundVertex, a: vec3f, b: vec3f, c: vec3f) -> vec3f {
    // Relative to a corner, so that rounding is as fine far from the origin as it can be.
    return a + (b - a) * vertex.of_b + (c - a) * vertex.of_c;
}

// The cloth's unit normal at a vertex, from positions (m) and normals of the corners; 0 where there is no area.
fn cloth_normal(vertex: BoundVertex, a: vec3f, b: vec3f, c: vec3f, normals: array<vec3f, 3>) -> vec3f {
    let weights = vertex.normal_weights;
    let smoothed = unit(normals[0] * weights.x + normals[1] * weights.y + normals[2] * weights.z);
    if any(smoothed != vec3f()) {
        return smoothed;
    }
    return unit(cross(b - a, c - a));
}

// The render mesh's unit normal at a vertex, from the positions (m) of the corners and the cloth's normal there; 0 if it has none.
fn render_normal(vertex: BoundVertex, a: vec3f, b: vec3f, c: vec3f, cloth_normal: vec3f) -> vec3f {
    let parts = vertex.normal;
    let area = cross(b - a, c - a);
    let sum = cross(c - a, cloth_normal) * parts.x + cross(cloth_normal, b - a) * parts.y + area * parts.z;
    return unit(sum * select(-1.0, 1.0, dot(area, cloth_normal) >= 0.0));
}
