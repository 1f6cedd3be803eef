// Whether the closest points of a pair are the closest ones of the surfaces around them: src/contact/contacts/near/voronoi.rs has the
// theory.

// A vertex counts as above a side or a corner, too, if it is beyond by an angle of at most this.
const ABOVE_ANGLE: f32 = 0.01;
// A closest point is on a side or at a corner if a weight is less than this.
const ON_SIDE: f32 = 1e-5;
// Edges run alongside each other if the squared sine of the angle between them is less than this.
const ALONGSIDE: f32 = 0.01;

fn is_above(apart: vec3f, way: vec3f) -> bool {
    return dot(apart, way) <= ABOVE_ANGLE * length(apart) * length(way);
}

// Whether the point of a triangle with these weights, from which vertex `v` is `apart`, is the point of the surface around it
// that is closest to the vertex, and the vertex the point of its surface that is closest to it.
fn is_closest(v: u32, corners: vec3u, weights: vec3f, apart: vec3f) -> bool {
    let is_used = weights < vec3f(-ON_SIDE);
    if all(is_used) {
        return true;
    }
    let a = select(select(corners.z, corners.y, is_used.y), corners.x, is_used.x);
    let b = select(select(corners.x, corners.y, is_used.y), corners.z, is_used.z);
    let side = vertices[b].x.xyz - vertices[a].x.xyz;
    return is_above_triangles(v, v, -apart, vec3f()) && is_above_triangles(a, b, apart, side);
}

// Whether what is `apart` from a side from `a` to `b` is not beyond it on any of the triangles there; if both are one corner,
// on any around it.
fn is_above_triangles(a: u32, b: u32, apart: vec3f, side: vec3f) -> bool {
    let start = vertices[a].x.xyz;
    let last = table[contact_params.triangles_at + a + 1u];
    for (var k = table[contact_params.triangles_at + a]; k < last; k++) {
        let around = triangle(table[k]);
        if !any(around == vec3u(b)) {
            continue;
        }
        for (var c = 0u; c < 3u; c++) {
            let way = vertices[around[c]].x.xyz - start;
            if around[c] != b && !is_above(apart, without(way, side)) {
                return false;
            }
        }
    }
    return true;
}

// Whether the closest points of edges, which are apart in a direction, are the closest ones of the surfaces around them, if the edges
// run alongside each other.
fn are_edges_closest(corners: vec4u, at: Four, apart: vec3f) -> bool {
    let first = at.b - at.a;
    let second = at.d - at.c;
    if square(cross(first, second)) >= square(first) * square(second) * ALONGSIDE {
        return true;
    }
    return is_above_triangles(corners.x, corners.y, -apart, first) && is_above_triangles(corners.z, corners.w, apart, second);
}
