// A pair of features that may collide: a vertex and a triangle, or two edges. src/kernels/pair.rs has the theory.

const RELAXATION: f32 = 1.7;
const THIN: f32 = 1e-6;
const NARROW: f32 = 0.2;
const LONG: f32 = 1e-6;
const PARALLEL: f32 = 1e-6;
const SLACK: f32 = 0.01;
const DEEP: f32 = 0.2;
const UNWINDING: f32 = 0.125;
// A pair with a kinematic side is squeezed if it is too close by more than this share of its thickness.
const SQUEEZED: f32 = 0.3;

// The corners of a pair, and the weights with which they form the closest points (positive on one side, negative on the
// other).
struct Four {
    a: vec3f,
    b: vec3f,
    c: vec3f,
    d: vec3f,
}

// The multipliers of a pair [kg m]: of friction, and of the normal.
struct Multipliers {
    lambda_t: vec3f,
    lambda_n: f32,
}

fn square(a: vec3f) -> f32 {
    return dot(a, a);
}

// The vector from the second side's closest point to the first's; of displacements, the relative displacement.
fn between(weights: vec4f, at: Four) -> vec3f {
    return at.a * weights.x + at.b * weights.y + at.c * weights.z + at.d * weights.w;
}

fn without(v: vec3f, t: vec3f) -> vec3f {
    return v - t * (dot(v, t) / max(square(t), 1e-30));
}

// Whether rounding may tilt the vector between the closest points of a pair.
fn is_tilted(distance: f32, thickness: f32, at: Four, is_edge: bool) -> bool {
    let first = select(at.c - at.b, at.b - at.a, is_edge);
    let second = select(at.d - at.b, at.d - at.c, is_edge);
    return distance < thickness * NARROW || distance * distance < max(square(first), square(second)) * LONG;
}

// The part of `apart`, the vector between the closest points, that is perpendicular to the corners that these points lie
// between.
fn perpendicular(apart: vec3f, weights: vec4f, at: Four, is_edge: bool) -> vec3f {
    let used = select(vec4f(1.0), vec4f(), weights == vec4f());
    var first = (at.b - at.a) * (used.x * used.y);
    var second = (at.d - at.c) * (used.z * used.w);
    if !is_edge {
        // Two sides of the triangle if the point is inside, the side on which it is, or none.
        first = (at.c - at.b) * (used.y * used.z) + (at.d - at.c) * (used.z * used.w * (1.0 - used.y));
        second = (at.d - at.b) * (used.y * used.w);
    }
    let across = without(second, first);
    let part = without(apart, first);
    // Parallel sides are one direction.
    if square(across) > square(second) * THIN {
        return without(part, across);
    }
    return part;
}

// The parameter, from 0 to 1, of the point on the segment `b` that is nearest to `a`; both start at the origin.
fn along(a: vec3f, b: vec3f) -> f32 {
    return clamp(dot(a, b) / max(square(b), 1e-30), 0.0, 1.0);
}

// The weights of the closest points of a vertex and a triangle.
fn vertex_triangle(at: Four) -> vec4f {
    let weights = in_triangle(at.a, at.b, at.c, at.d);
    return vec4f(1.0, weights.x + weights.y - 1.0, -weights.x, -weights.y);
}

// The weights of a triangle's second and third corner at its point nearest to `p` (Ericson 2004, 5.1.5).
fn in_triangle(p: vec3f, a: vec3f, b: vec3f, c: vec3f) -> vec2f {
    let ab = b - a;
    let ac = c - a;
    let ap = p - a;
    let bp = p - b;
    let cp = p - c;
    let d1 = dot(ab, ap);
    let d2 = dot(ac, ap);
    let d3 = dot(ab, bp);
    let d4 = dot(ac, bp);
    let d5 = dot(ab, cp);
    let d6 = dot(ac, cp);
    let va = d3 * d6 - d5 * d4;
    let vb = d5 * d2 - d1 * d6;
    let vc = d1 * d4 - d3 * d2;
    if !(va + vb + vc > square(ab) * square(ac) * THIN) {
        // A degenerate triangle has no interior in single precision; use the closest point on its sides.
        let s = along(ap, ab);
        let t = along(ap, ac);
        let r = along(bp, c - b);
        let near_ab = square(ap - ab * s);
        let near_ac = square(ap - ac * t);
        let near_bc = square(bp - (c - b) * r);
        if near_bc < min(near_ab, near_ac) {
            return vec2f(1.0 - r, r);
        }
        return select(vec2f(s, 0.0), vec2f(0.0, t), near_ac < near_ab);
    }
    if d1 <= 0.0 && d2 <= 0.0 {
        return vec2f();
    }
    if d3 >= 0.0 && d4 <= d3 {
        return vec2f(1.0, 0.0);
    }
    if d6 >= 0.0 && d5 <= d6 {
        return vec2f(0.0, 1.0);
    }
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return vec2f(d1 / (d1 - d3), 0.0);
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return vec2f(0.0, d2 / (d2 - d6));
    }
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let along_bc = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return vec2f(1.0 - along_bc, along_bc);
    }
    return vec2f(vb, vc) / (va + vb + vc);
}

// The weights of the closest points of two edges (Ericson 2004, 5.1.9).
fn edge_edge(at: Four) -> vec4f {
    let d1 = at.b - at.a;
    let d2 = at.d - at.c;
    let r = at.a - at.c;
    let a = max(square(d1), 1e-30);
    let e = max(square(d2), 1e-30);
    let f = dot(d2, r);
    let c = dot(d1, r);
    let b = dot(d1, d2);
    let across = a * e - b * b;
    // On parallel edges any point will do.
    var s = 0.0;
    if across >= a * e * PARALLEL {
        s = clamp((b * f - c * e) / max(across, 1e-30), 0.0, 1.0);
    }
    let t = clamp((b * s + f) / e, 0.0, 1.0);
    // If the second parameter was clamped, the first changes too.
    s = clamp((b * t - c) / a, 0.0, 1.0);
    return vec4f(1.0 - s, s, t - 1.0, -t);
}

// One Jacobi step of a pair's multipliers, with Coulomb friction.
fn step_of_lambda(held: Multipliers, normal: vec3f, gap: f32, relative: vec3f, rate: f32, friction: f32) -> Multipliers {
    let apart = dot(normal, relative);
    let lambda_n = max(held.lambda_n - rate * (gap + apart), 0.0);
    let lambda_t = held.lambda_t - (relative - normal * apart) * rate;
    let most = friction * lambda_n;
    let size = length(lambda_t);
    return Multipliers(lambda_t * select(1.0, most / max(size, 1e-30), most < size), lambda_n);
}

// The impulse [kg m] of a pair's multipliers.
fn impulse(held: Multipliers, normal: vec3f) -> vec3f {
    return normal * held.lambda_n + held.lambda_t;
}

// The distance [m] at which the response holds a pair apart, given the weights of its kinematic corners, and 0 for the others.
fn held_distance(thickness: f32, kinematic: vec4f) -> f32 {
    let first = max(kinematic, vec4f());
    let second = max(-kinematic, vec4f());
    let both = min((first.x + first.y) + (first.z + first.w), (second.x + second.y) + (second.z + second.w));
    return thickness * max(1.0 - both, 0.0);
}

// The correction [m] of a pair that is too close by `depth` [m]: in proportion to what it is beyond the slack, and at
// most `most` [m].
fn separation(depth: f32, thickness: f32, most: f32) -> f32 {
    return max(depth - thickness * SLACK, 0.0) * (most / max(thickness, most));
}

// The share of the last substep's multipliers with which a pair starts that is too close by `depth` [m].
fn warm_share(depth: f32, thickness: f32) -> f32 {
    return 1.0 - max(depth - thickness * DEEP, 0.0) * (UNWINDING / thickness);
}

// The weights of the closest points of two edges, or of a vertex and a triangle.
fn closest(is_edge: bool, at: Four) -> vec4f {
    if is_edge {
        return edge_edge(at);
    }
    return vertex_triangle(at);
}
