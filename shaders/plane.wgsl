// A plane between the two sides of a pair, which none of its corners may cross. src/kernels/plane.rs has the theory.

const CLEARANCE: f32 = 0.05;
const SEPARATES: f32 = 0.03;
const BEFORE_KINEMATIC: f32 = 0.6;
const SLIDING: f32 = 1.6;
// More than any height [m].
const FAR: f32 = 3e38;

// A plane between the sides of a pair: its unit normal, toward the first side, the distance [m] of each corner on its side, and the
// distance that it keeps.
struct Plane {
    normal: vec3f,
    heights: vec4f,
    clearance: f32,
}

// How far the corners of a pair may move without crossing a plane: the plane where kinematic corners hold and have shifted it, how far [m]
// corners are about to move toward it, and the share of its displacement that is left to each; how far the plane moves past a corner, or
// two kinematic sides into each other.
struct Held {
    plane: Plane,
    towards: vec4f,
    shares: vec4f,
    passed_by: f32,
}

// 1 for the corners of the first side, 0 for those of the second.
fn firsts_of(is_edge: bool) -> vec4f {
    return select(vec4f(1.0, 0.0, 0.0, 0.0), vec4f(1.0, 1.0, 0.0, 0.0), is_edge);
}

fn least_of(v: vec4f) -> f32 {
    return min(min(v.x, v.y), min(v.z, v.w));
}

fn most_of(v: vec4f) -> f32 {
    return max(max(v.x, v.y), max(v.z, v.w));
}

fn along_normal(normal: vec3f, v: Four) -> vec4f {
    return vec4f(dot(normal, v.a), dot(normal, v.b), dot(normal, v.c), dot(normal, v.d));
}

// The plane across a unit vector halfway between the sides.
fn halfway(normal: vec3f, at: Four, thickness: f32, is_edge: bool) -> Plane {
    let along = along_normal(normal, Four(vec3f(), at.b - at.a, at.c - at.a, at.d - at.a));
    let firsts = firsts_of(is_edge);
    let first = least_of(select(vec4f(FAR), along, firsts > vec4f()));
    let second = most_of(select(along, vec4f(-FAR), firsts > vec4f()));
    let heights = (2.0 * firsts - 1.0) * (along - 0.5 * (first + second));
    return Plane(normal, heights, clearance(first - second, thickness));
}

// The distance [m] between the sides along the normal, given the heights of corners.
fn gap_of(heights: vec4f, is_edge: bool) -> f32 {
    let is_first = firsts_of(is_edge) > vec4f();
    return least_of(select(vec4f(FAR), heights, is_first)) + least_of(select(heights, vec4f(FAR), is_first));
}

// The plane that is at most `BEFORE_KINEMATIC` thicknesses from a side all of whose corners are kinematic, if none of the other side's
// are.
fn before_kinematic(plane: Plane, is_kinematic: vec4<bool>, thickness: f32, is_edge: bool) -> Plane {
    let sides = 2.0 * firsts_of(is_edge) - 1.0;
    let is_first = sides > vec4f();
    let is_second = sides < vec4f();
    let most = BEFORE_KINEMATIC * thickness;
    var toward_first = 0.0;
    if all(is_kinematic == is_first) {
        toward_first = max(least_of(select(vec4f(FAR), plane.heights, is_first)) - most, 0.0);
    } else if all(is_kinematic == is_second) {
        toward_first = -max(least_of(select(vec4f(FAR), plane.heights, is_second)) - most, 0.0);
    }
    return Plane(plane.normal, plane.heights - sides * toward_first, plane.clearance);
}

// How far corners with displacements `u` may move. Kinematic ones are not shortened. As far as one of them would cross the plane, the
// plane is shifted; if both sides push, by the difference.
fn hold(halfway: Plane, u: Four, is_kinematic: vec4<bool>, thickness: f32, is_edge: bool) -> Held {
    let firsts = firsts_of(is_edge);
    let sides = 2.0 * firsts - 1.0;
    let plane = before_kinematic(halfway, is_kinematic, thickness, is_edge);
    let are_both = any(is_kinematic & (firsts > vec4f())) && any(is_kinematic & (firsts == vec4f()));
    let towards = -sides * along_normal(plane.normal, u);
    let out = select(vec4f(), max(plane.clearance - (plane.heights - towards), vec4f()), is_kinematic);
    let from_first = most_of(out * firsts);
    let from_second = most_of(out * (1.0 - firsts));
    let heights = plane.heights - sides * (from_second - from_first);
    let shares = vec4f(
        share_above(heights.x, plane.clearance, towards.x),
        share_above(heights.y, plane.clearance, towards.y),
        share_above(heights.z, plane.clearance, towards.z),
        share_above(heights.w, plane.clearance, towards.w),
    );
    let both = select(0.0, from_second + from_first - 2.0 * plane.clearance, are_both);
    let passed_by = max(both, most_of(select(-heights, vec4f(), is_kinematic)));
    let shifted = Plane(plane.normal, heights, plane.clearance);
    return Held(shifted, towards, select(shares, vec4f(1.0), is_kinematic), max(passed_by, 0.0));
}

// Whether the plane stays between the sides of a pair without kinematic corners if it moves along with it.
fn stays_between(plane: Plane, towards: vec4f, is_edge: bool) -> bool {
    return least_of(plane.heights) > 0.0 && gap_of(plane.heights - towards, is_edge) > 2.0 * plane.clearance;
}

// How far corners may move without crossing the plane that leaves the largest share to the one that is shortened most: this one, by
// which they are held, or another that separates the sides.
fn least_shortening(plane: Plane, by_plane: Held, at: Four, u: Four, is_kinematic: vec4<bool>, thickness: f32, is_edge: bool) -> Held {
    let least_gap = SEPARATES * gap_of(plane.heights, is_edge);
    var normals = sliding_normals(plane.normal, at, u, is_edge);
    var held = by_plane;
    for (var k = 0; k < 2; k++) {
        let other = halfway(normals[k], at, thickness, is_edge);
        let by = hold(other, u, is_kinematic, thickness, is_edge);
        let shortens_less = by.passed_by == held.passed_by && least_of(by.shares) > least_of(held.shares);
        if (by.passed_by < held.passed_by || shortens_less) && gap_of(other.heights, is_edge) > least_gap {
            held = by;
        }
    }
    return held;
}

fn unit(v: vec3f) -> vec3f {
    return v / max(length(v), 1e-30);
}

// The normals of planes along which the sides of a pair may slide.
fn sliding_normals(apart: vec3f, at: Four, u: Four, is_edge: bool) -> array<vec3f, 2> {
    var way = u.a - (u.b + u.c + u.d) / 3.0;
    var across = cross(at.c - at.b, at.d - at.b);
    if is_edge {
        way = u.a + u.b - u.c - u.d;
        let first = at.b - at.a;
        let second = at.d - at.c;
        across = cross(first, second);
        if square(across) < square(first) * square(second) * PARALLEL {
            across = cross(first, way);
        }
    }
    across = select(across, -across, dot(across, apart) < 0.0);
    return array(unit(without(apart, way)), unit(across));
}

// The distance [m] that a vertex keeps to the plane between the sides of a pair.
fn clearance(distance: f32, thickness: f32) -> f32 {
    return max(distance * CLEARANCE, min(distance * 0.5, thickness * CLEARANCE));
}

// The share of a displacement toward a plane that keeps this distance.
fn share_above(height: f32, clearance: f32, toward: f32) -> f32 {
    if toward > 0.0 && height - toward < clearance {
        return clamp((height - clearance) / toward, 0.0, 1.0);
    }
    return 1.0;
}

// What is to be removed [m] from a displacement so that it slides along planes.
fn excess(weighted: vec3f, squares: f32) -> vec3f {
    return weighted * (SLIDING * squares / max(square(weighted), 1e-30));
}
