// Pairs of a vertex that lies in a triangle at the start. The vector between the two has no direction, so the side on which
// the vertex belongs follows from the orientation of the surfaces: `src/contact/coincident.rs`.

// Distances at the start below this multiple of the thickness count as zero.
const TOUCHING: f32 = 1e-4;

// Whether there are no multipliers from an earlier substep.
fn begins() -> bool {
    return known.status.scale == 0.0;
}

// The direction from the triangle to the side on which the vertex belongs, or 0 if there is none.
//
// Cloth belongs in front of a mesh collider. If two layers of cloth face each other, each is in front of the other. If they
// face the same way, the one whose vertices have the higher indices is in front.
fn facing(corners: vec4u) -> vec3f {
    let at = positions(corners);
    let of_triangle = normal_of(at.b, at.c, at.d);
    var of_vertex = vec3f();
    let around = triangle_at(corners.x);
    if around != NONE {
        let beside = positions(vec4u(triangle(around), corners.x));
        of_vertex = normal_of(beside.a, beside.b, beside.c);
    }
    if corners.x >= about.vertices {
        return select(vec3f(), -of_vertex, any(of_triangle != vec3f()));
    }
    let is_behind = corners.y < about.vertices && corners.x < corners.y && dot(of_vertex, of_triangle) > 0.0;
    return select(of_triangle, -of_triangle, is_behind);
}
