// Colliders, and what they do to a vertex about to move. The reasons are in src/kernels/contact.rs.

struct Body {
    a: vec3f,
    radius: f32,
    b: vec3f,
    friction: f32,
    a_travel: vec3f,
    radius_travel: f32,
    b_travel: vec3f,
    kind: u32,
}

const PLANE: u32 = 0u;
const DEPENETRATION: f32 = 1.0;
const SWEPT: f32 = 0.25;
const SWEEP_STEPS: u32 = 24u;

// Where a vertex is and how it will move.
struct Path {
    x: vec3f,
    u: vec3f,
}

// First touch of a path: its normal, and the gap that the path's end leaves to the tangent plane.
struct Touch {
    hit: bool,
    n: vec3f,
    after: f32,
}

fn nearest(a: vec3f, b: vec3f, x: vec3f) -> f32 {
    let axis = b - a;
    return clamp(dot(x - a, axis) / max(dot(axis, axis), 1e-20), 0.0, 1.0);
}

fn swept(x: vec3f, du: vec3f, a: vec3f, b: vec3f, radius: f32, travel: f32) -> Touch {
    var s = 0.0;
    for (var k = 0u; k < SWEEP_STEPS; k++) {
        let at = x + du * s;
        let d = at - (a + (b - a) * nearest(a, b, at));
        let distance = length(d);
        if distance < radius * 1.001 {
            let n = d / max(distance, 1e-20);
            return Touch(true, n, distance - radius + dot(n, du) * (1.0 - s));
        }
        s += (distance - radius) / travel;
        if s >= 1.0 {
            break;
        }
    }
    return Touch(false, vec3f(), 0.0);
}

fn respond(x: vec3f, u: vec3f, n: vec3f, before: f32, after: f32, step: vec3f, friction: f32) -> Path {
    if after >= 0.0 {
        return Path(x, u);
    }
    let depth = -after;
    let old = min(depth, max(-before, 0.0));
    let push = depth - old;
    let pushed = u + n * push;
    let relative = pushed - step;
    let slip = relative - n * dot(n, relative);
    let held = pushed - slip * min(friction * push / max(length(slip), 1e-30), 1.0);
    return Path(x + n * min(old, DEPENETRATION * params.h), held);
}

fn contact_body(x: vec3f, u: vec3f, body: Body, substep: Substep) -> Path {
    let a = body.a + body.a_travel * substep.start;
    let a_step = body.a_travel * params.fraction;
    if body.kind == PLANE {
        let before = dot(body.b, x - a);
        return respond(x, u, body.b, before, before + dot(body.b, u - a_step), a_step, body.friction);
    }
    let b = body.b + body.b_travel * substep.start;
    let b_step = body.b_travel * params.fraction;
    let radius = body.radius + body.radius_travel * substep.start;
    let growth = body.radius_travel * params.fraction;
    let t = nearest(a + a_step, b + b_step, x + u);
    let step = a_step + (b_step - a_step) * t;
    let d0 = x - (a + (b - a) * t);
    let du = u - step;
    let d = d0 + du;
    let start = length(d0);
    let end = length(d);
    let before = start - radius;
    let travel2 = dot(du, du);
    if before > -SWEPT * radius && travel2 > SWEPT * SWEPT * radius * radius {
        let touch = swept(x, du, a, b, radius, sqrt(travel2));
        if touch.hit {
            return respond(x, u, touch.n, before, touch.after - growth, step, body.friction);
        }
    }
    let after = before + (2.0 * dot(d0, du) + travel2) / max(start + end, 1e-20) - growth;
    var n = vec3f(0.0, 1.0, 0.0);
    if end > LEAST_LENGTH {
        n = d / end;
    }
    return respond(x, u, n, before, after, step, body.friction);
}
