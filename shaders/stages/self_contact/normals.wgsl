// Bounds of the normals of triangles, from which follows that cloth is not folded over.

// Cosine of the angle of a cone. If the normals of connected cloth are within such a cone, it is not folded over.
const CONE_COSINE: f32 = 0.64;

struct Normals {
    low: vec3f,
    high: vec3f,
}

// Bounds of the normals of each triangle of the cloth on its path.
@group(1) @binding(17) var<storage, read_write> normals: array<Normals>;

// Whether all unit vectors within bounds are in one cone of `CONE_COSINE`.
fn in_one_cone(n: Normals) -> bool {
    let axis = n.low + n.high;
    let least = dot(min(n.low * axis, n.high * axis), vec3f(1.0));
    return least > 0.0 && least * least > CONE_COSINE * CONE_COSINE * square(axis);
}

fn normalize_or_zero(v: vec3f) -> vec3f {
    let size = length(v);
    return select(vec3f(), v / size, size > 0.0);
}

// Bounds of the unit normals of a triangle whose vertices stray from their paths.
fn normals_on_path(a: Track, b: Track, c: Track) -> Normals {
    let first = array(b.start.xyz - a.start.xyz, c.start.xyz - a.start.xyz, c.start.xyz - b.start.xyz);
    let by = array(b.by.xyz - a.by.xyz, c.by.xyz - a.by.xyz, c.by.xyz - b.by.xyz);
    var last = first;
    var longest = 0.0;
    for (var k = 0u; k < 3u; k++) {
        last[k] += by[k] * contact_state.status.ahead;
        longest = max(longest, max(square(first[k]), square(last[k])));
    }
    let before = cross(first[0], first[1]);
    let after = cross(last[0], last[1]);
    let between = (before + after - cross(last[0] - first[0], last[1] - first[1])) * 0.5;
    let one = normalize_or_zero(before);
    let two = normalize_or_zero(between);
    let three = normalize_or_zero(after);
    let twice_area = min(length(before), min(dot(one, between), dot(one, after)));
    if may_tilt(twice_area, sqrt(longest), max(max(a.start.w, b.start.w), c.start.w)) {
        return Normals(vec3f(-1.0), vec3f(1.0));
    }
    return Normals(min(min(one, two), three), max(max(one, two), three));
}

// Whether straying may tilt a triangle, given by twice its area and its longest side, by more than a cone leaves up to a right
// angle.
fn may_tilt(twice_area: f32, longest: f32, margin: f32) -> bool {
    return 2.0 * margin * longest >= CONE_COSINE * twice_area;
}
