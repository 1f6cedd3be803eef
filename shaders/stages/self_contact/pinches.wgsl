// Cloth that is pinched between kinematic vertices.

// Six times the signed volume [m³] of a tetrahedron.
fn volume(t: Four) -> f32 {
    return dot(cross(t.b - t.a, t.c - t.a), t.d - t.a);
}

// Features meet if they come closer than this multiple of the thickness. What is that close before or after does not tell
// on which side it is.
const COINCIDENT: f32 = 1e-3;
// Bisections that find the moment at which four points are in a plane.
const BISECTIONS: u32 = 20u;

fn moved(start: Four, end: Four, share: f32) -> Four {
    return Four(mix(start.a, end.a, share), mix(start.b, end.b, share), mix(start.c, end.c, share), mix(start.d, end.d, share));
}

// Whether the features of a pair, the volume of whose corners changes its sign, meet while these move straight.
fn moves_through(is_edge: bool, start: Four, end: Four) -> bool {
    let before = volume(start);
    var early = 0.0;
    var late = 1.0;
    for (var k = 0u; k < BISECTIONS; k++) {
        let middle = 0.5 * (early + late);
        if before * volume(moved(start, end, middle)) > 0.0 {
            early = middle;
        } else {
            late = middle;
        }
    }
    let least = COINCIDENT * contact_params.thickness;
    let nearest = distance_of(is_edge, moved(start, end, late));
    return nearest < least && least < min(distance_of(is_edge, start), distance_of(is_edge, end));
}

// The distance between the features of a pair [m].
fn distance_of(is_edge: bool, at: Four) -> f32 {
    return length(between(closest(is_edge, at), at));
}

// Where a vertex is at the end of the substep.
fn end_of(v: u32) -> vec3f {
    return vertices[v].x.xyz + vertices[v].push.xyz + vertices[v].u.xyz;
}
