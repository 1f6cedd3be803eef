// Collision of a vertex with an analytic collider. The derivations are in src/kernels/contact.rs.

struct Body {
    a: vec3f,
    radius: f32,
    b: vec3f,
    friction: f32,
    a_travel: vec3f,
    radius_travel: f32,
    b_travel: vec3f,
    kind: u32,
    c: vec4f,
    c_travel: vec4f,
    slick: f32,
    margin: f32,
    padding: array<f32, 2>,
}

const PLANE: u32 = 0u;
const BOX: u32 = 2u;
const DEPENETRATION: f32 = 1.0;
const EMERGENCE: f32 = 0.05;
const INSIDE: f32 = 1e-5;
const SWEPT: f32 = 0.25;
const SWEEP_STEPS: u32 = 24u;
// A path touches a body at less than this share of its radius, or of half a box's thickness.
const TOUCHING: f32 = 0.001;

// How `entered` ranks the faces of a box: see src/kernels/contact/rounded_box.rs.
const ROUNDING: f32 = 9.5367431640625e-7;
const PRESSED: f32 = 1e-5;
const WAS_OUTSIDE: f32 = 8.0;
const SLID: f32 = 4.0;
const CARRIES: f32 = 2.0;

// A vertex among the bodies that it may touch in a substep: its position, moved out of them so far, its displacement, its position
// before, the displacement there of the body with the most friction of those so far that it began inside of, and its friction; of two
// with the same, the mean.
struct Path {
    x: vec3f,
    u: vec3f,
    start: vec3f,
    holder_step: vec3f,
    grasp: f32,
}

// The first touch of a path with a surface: the normal there, and the gap between the path's end and the tangent plane.
struct Touch {
    hit: bool,
    n: vec3f,
    after: f32,
}

// Where a path ends on a box, and whether it slid along that face.
struct BoxEnd {
    touch: Touch,
    slides: bool,
}

// The face through which a path entered a box, and whether it slid along it.
struct Entry {
    axis: vec3f,
    slid: bool,
}

// The normal and the signed distance at the point of a surface that is nearest to a given point.
struct Gap {
    n: vec3f,
    distance: f32,
}

// Where a vertex meets a body in a substep: the body's normal where the vertex touches it, or is nearest to it at the end; the
// signed gap at the substep's start, and at its end if nothing is done; and the body's displacement there.
struct ContactPoint {
    n: vec3f,
    before: f32,
    after: f32,
    step: vec3f,
    grip: f32,
}

fn nearest(a: vec3f, b: vec3f, taper: f32, x: vec3f) -> f32 {
    let axis = b - a;
    let square = dot(axis, axis);
    let along = dot(x - a, axis) / max(square, 1e-20);
    if taper == 0.0 {
        return clamp(along, 0.0, 1.0);
    }
    let cone = square - taper * taper;
    if cone <= 0.0 {
        return select(0.0, 1.0, taper > 0.0);
    }
    let across = length(x - a - axis * along);
    return clamp(along + across * taper / sqrt(cone * square), 0.0, 1.0);
}

fn swept(x: vec3f, du: vec3f, a: vec3f, b: vec3f, radius_a: f32, taper: f32, travel: f32) -> Touch {
    var s = 0.0;
    for (var k = 0u; k < SWEEP_STEPS; k++) {
        let at = x + du * s;
        let t = nearest(a, b, taper, at);
        let d = at - (a + (b - a) * t);
        let distance = length(d);
        let radius = radius_a + taper * t;
        let gap = distance - radius;
        if gap < TOUCHING * radius {
            let n = d / max(distance, 1e-20);
            return Touch(true, n, gap + dot(n, du) * (1.0 - s));
        }
        s += gap / travel;
        if s >= 1.0 {
            break;
        }
    }
    return Touch(false, vec3f(), 0.0);
}

fn path_of(x: vec3f, u: vec3f) -> Path {
    return Path(x, u, x, vec3f(), 0.0);
}

fn respond(path: Path, contact: ContactPoint, body: Body) -> Path {
    let n = contact.n;
    // Not of a gap that is not a number, either.
    if !(contact.after < 0.0) {
        return path;
    }
    let depth = -contact.after;
    let old = min(depth, max(-contact.before, 0.0));
    let push = depth - old;
    let pushed = path.u + n * push;
    let relative = pushed - contact.step;
    let slip = relative - n * dot(n, relative);
    let grip = body.friction * contact.grip;
    let share = grip * push / max(length(slip), 1e-30);
    let below = min(old - body.margin, DEPENETRATION * params.h);
    let freed = min(old, max(below, EMERGENCE * params.h));
    let out = path.x + n * freed;
    var after = Path(out, pushed - slip * min(share, 1.0), path.start, path.holder_step, path.grasp);
    if old > INSIDE {
        if grip > path.grasp {
            after.holder_step = contact.step;
            after.grasp = grip;
        } else if grip == path.grasp {
            after.holder_step = 0.5 * (path.holder_step + contact.step);
        }
        let moved = path.x - path.start;
        let slid = moved - n * dot(n, moved);
        let least = min(INSIDE, 0.5 * EMERGENCE * params.h);
        if dot(n, moved) < -least && length(slid) < after.grasp * freed {
            let sticks = after.holder_step - pushed;
            after.x = out - slid;
            after.u = pushed + sticks - n * dot(n, sticks);
        }
    }
    return after;
}

fn contact_box(x: vec3f, u: vec3f, body: Body, substep: Substep) -> ContactPoint {
    let arm = x - (body.a + body.a_travel * substep.start);
    let rotation = body.c + body.c_travel * substep.start;
    let change = body.c_travel * params.fraction;
    let g = turn(rotation, change);
    let across = cross(g, arm);
    let step = body.a_travel * params.fraction + (across + cross(g, across)) * (2.0 / (1.0 + dot(g, g)));
    let ends = normalize(rotation + change);
    let y = turned_back(normalize(rotation), arm);
    let dy = turned_back(ends, u - step);

    let core = body.b + body.b_travel * substep.start;
    let core_step = body.b_travel * params.fraction;
    let radius = body.radius + body.radius_travel * substep.start;
    let growth = body.radius_travel * params.fraction;
    let before = box_gap(y, core, radius).distance;
    let thin = SWEPT * (min(core.x, min(core.y, core.z)) + radius);
    let travel2 = dot(dy, dy);
    let size = max_element(abs(body.a)) + max_element(core) + radius;
    let end = box_end(y, dy, core, core_step, radius, turned_back(ends, params.up), ROUNDING * size);
    var touch = end.touch;
    if before > -thin && travel2 > thin * thin {
        let on_the_way = swept_box(y, dy, core, radius, sqrt(travel2));
        if on_the_way.hit && !end.slides {
            touch = on_the_way;
        }
    }
    let share = grip(y + dy, core + core_step, radius, body.slick);
    return ContactPoint(turned(ends, touch.n), before, touch.after - growth, step, share);
}

fn grip(end: vec3f, core: vec3f, radius: f32, slick: f32) -> f32 {
    let beyond = abs(end) - core;
    let second = max(min(beyond.x, beyond.y), min(max(beyond.x, beyond.y), beyond.z));
    return min((radius - min(second, 0.0)) / max(slick, MIN_LENGTH), 1.0);
}

// The point of a box's surface that is nearest to a path's end, or on the face through which it entered.
fn box_end(y: vec3f, dy: vec3f, core: vec3f, core_step: vec3f, radius: f32, up: vec3f, rounding: f32) -> BoxEnd {
    let side = toward(y + dy);
    let beyond = abs(y + dy) - (core + core_step);
    let outside = positive(beyond);
    let planes = dot(outside, vec3f(1.0));
    let d0 = outside * (y - side * core);
    let dd = outside * (dy - side * core_step);
    let start = length(d0);
    let end = length(d0 + dd);
    if planes > 1.0 && end > MIN_LENGTH {
        let after = start - radius + (2.0 * dot(d0, dd) + dot(dd, dd)) / (start + end);
        return BoxEnd(Touch(true, (d0 + dd) / end, after), false);
    }
    var entry = Entry(farthest(beyond), false);
    if planes < 1.0 {
        entry = entered(side * y - (core + radius), side * dy - core_step, beyond, side * up, rounding);
    }
    let axis = entry.axis;
    let n = side * axis;
    let after = (dot(n, y) - dot(axis, core)) - radius + dot(n, dy) - dot(axis, core_step);
    return BoxEnd(Touch(true, n, after), entry.slid);
}

// The face that holds a point which ends in the core: see src/kernels/contact/rounded_box.rs.
fn entered(start: vec3f, away: vec3f, beyond: vec3f, up: vec3f, rounding: f32) -> Entry {
    let way = length(away);
    let was_outside = start > vec3f(-rounding);
    let slid = was_outside & (start < vec3f(rounding)) & (away < vec3f(-PRESSED * way));
    let leaves = (farthest(beyond) > vec3f()) & (away > vec3f());
    let rank = vec3f(WAS_OUTSIDE) + up * CARRIES + select(vec3f(), vec3f(SLID), slid | leaves);
    let axis = farthest(select(beyond, beyond + rank * (way + rounding), was_outside | leaves));
    return Entry(axis, abs(dot(axis, start)) < rounding && dot(axis, away) < -PRESSED * way);
}

fn swept_box(y: vec3f, dy: vec3f, core: vec3f, radius: f32, travel: f32) -> Touch {
    let touching = TOUCHING * (min(core.x, min(core.y, core.z)) + radius);
    var s = 0.0;
    for (var k = 0u; k < SWEEP_STEPS; k++) {
        let at = box_gap(y + dy * s, core, radius);
        if at.distance < touching {
            return Touch(true, at.n, at.distance + dot(at.n, dy) * (1.0 - s));
        }
        s += at.distance / travel;
        if s >= 1.0 {
            break;
        }
    }
    return Touch(false, vec3f(), 0.0);
}

fn box_gap(y: vec3f, core: vec3f, radius: f32) -> Gap {
    let side = toward(y);
    let beyond = abs(y) - core;
    let outside = positive(beyond);
    let d = outside * beyond;
    let l = length(d);
    if dot(outside, vec3f(1.0)) > 1.0 && l > MIN_LENGTH {
        return Gap(side * d / l, l - radius);
    }
    let axis = farthest(beyond);
    return Gap(side * axis, dot(axis, beyond) - radius);
}

fn max_element(v: vec3f) -> f32 {
    return max(v.x, max(v.y, v.z));
}

fn farthest(v: vec3f) -> vec3f {
    if v.x >= v.y && v.x >= v.z {
        return vec3f(1.0, 0.0, 0.0);
    }
    return select(vec3f(0.0, 0.0, 1.0), vec3f(0.0, 1.0, 0.0), v.y >= v.z);
}

fn toward(y: vec3f) -> vec3f {
    return select(vec3f(1.0), vec3f(-1.0), y < vec3f());
}

fn positive(v: vec3f) -> vec3f {
    return select(vec3f(), vec3f(1.0), v > vec3f());
}

fn turn(rotation: vec4f, change: vec4f) -> vec3f {
    let axis = change.xyz * rotation.w - rotation.xyz * change.w - cross(change.xyz, rotation.xyz);
    return axis / (dot(rotation, rotation) + dot(rotation, change));
}

fn turned(rotation: vec4f, v: vec3f) -> vec3f {
    let across = cross(rotation.xyz, v) * 2.0;
    return v + across * rotation.w + cross(rotation.xyz, across);
}

fn turned_back(rotation: vec4f, v: vec3f) -> vec3f {
    return turned(vec4f(-rotation.xyz, rotation.w), v);
}

fn contact_round(x: vec3f, u: vec3f, body: Body, substep: Substep) -> ContactPoint {
    let a = body.a + body.a_travel * substep.start;
    let a_step = body.a_travel * params.fraction;
    let b = body.b + body.b_travel * substep.start;
    let b_step = body.b_travel * params.fraction;
    let taper = body.c.x + body.c_travel.x * substep.start;
    let taper_step = body.c_travel.x * params.fraction;
    let t = nearest(a + a_step, b + b_step, taper + taper_step, x + u);
    let radius_a = body.radius + body.radius_travel * substep.start;
    let radius = radius_a + taper * t;
    let growth = body.radius_travel * params.fraction + taper_step * t;
    let step = a_step + (b_step - a_step) * t;
    let d0 = x - (a + (b - a) * t);
    let du = u - step;
    let d = d0 + du;
    let start = length(d0);
    let end = length(d);
    let before = start - radius;
    let travel2 = dot(du, du);
    if before > -SWEPT * radius && travel2 > SWEPT * SWEPT * radius * radius {
        let touch = swept(x, du, a, b, radius_a, taper, sqrt(travel2));
        if touch.hit {
            return ContactPoint(touch.n, before, touch.after - growth, step, 1.0);
        }
    }
    let after = before + (2.0 * dot(d0, du) + travel2) / max(start + end, 1e-20) - growth;
    var n = vec3f(0.0, 1.0, 0.0);
    if end > MIN_LENGTH {
        n = d / end;
    }
    return ContactPoint(n, before, after, step, 1.0);
}

// Of a half-space. While its normal turns, from n_0 to n in a substep, the solid also moves by (n_0 x n) x r at r from its point.
fn contact_plane(x: vec3f, u: vec3f, body: Body, substep: Substep) -> ContactPoint {
    let r = x - (body.a + body.a_travel * substep.start);
    var n = body.b;
    var step = body.a_travel * params.fraction;
    var before = dot(n, r);
    if any(body.b_travel != vec3f()) {
        let n_0 = normalize(body.b + body.b_travel * substep.start);
        n = normalize(body.b + body.b_travel * (substep.start + params.fraction));
        before = dot(n_0, r);
        let axis = cross(n_0, n);
        step += cross(axis, r + 0.5 * cross(axis, r));
    }
    return ContactPoint(n, before, before + dot(n, u - step), step, 1.0);
}

fn contact_body(path: Path, body: Body, substep: Substep) -> Path {
    var contact: ContactPoint;
    if body.kind == PLANE {
        contact = contact_plane(path.x, path.u, body, substep);
    } else if body.kind == BOX {
        contact = contact_box(path.x, path.u, body, substep);
    } else {
        contact = contact_round(path.x, path.u, body, substep);
    }
    return respond(path, contact, body);
}
