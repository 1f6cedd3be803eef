// A whole step of a cloth of one patch, in one workgroup: every substep, and at the end the commit.
// Displacements stay in workgroup memory throughout, those of a substep being the last ones of the next.

@group(1) @binding(1) var<storage, read> substeps: array<Substep>;
@group(1) @binding(2) var<storage, read> pins: array<Pin>;
@group(1) @binding(3) var<storage, read> bodies: array<Body>;
@group(1) @binding(4) var<storage, read_write> x: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> p: array<vec4f>;
@group(1) @binding(6) var<storage, read_write> work: array<vec4f>;
@group(1) @binding(7) var<storage, read_write> first_bad: atomic<u32>;

// Three numbers a vertex and nothing beside: room for 4096 of them in 48 KiB.
var<workgroup> by: array<f32, 3 * ROOM>;

fn moved(k: u32) -> vec3f {
    return vec3f(by[3u * k], by[3u * k + 1u], by[3u * k + 2u]);
}

fn move_by(k: u32, u: vec3f) {
    by[3u * k] = u.x;
    by[3u * k + 1u] = u.y;
    by[3u * k + 2u] = u.z;
}

// An edge with what does not change while edges are swept, fetched before it is its turn.
struct Held {
    edge: Edge,
    d0: vec3f,
    w_a: f32,
    w_b: f32,
}

fn hold(color: u32, k: u32) -> Held {
    let edge = edge_at(0u, color, k);
    if edge.a == NO_EDGE {
        return Held(edge, vec3f(), 0.0, 0.0);
    }
    let x_a = work[edge.a];
    let x_b = work[edge.b];
    return Held(edge, x_a.xyz - x_b.xyz, x_a.w, x_b.w);
}

fn correct(held: Held) {
    let edge = held.edge;
    if edge.a == NO_EDGE {
        return;
    }
    let u_a = moved(edge.a);
    let u_b = moved(edge.b);
    var impulse: vec3f;
    if params.relaxed != 0u {
        impulse = relax_edge(held.d0, u_a - u_b, edge);
    } else {
        impulse = project_edge(held.d0, u_a - u_b, edge);
    }
    move_by(edge.a, u_a + impulse * held.w_a);
    move_by(edge.b, u_b - impulse * held.w_b);
}

@compute @workgroup_size(LANES)
fn step_of_whole(@builtin(local_invocation_index) lane: u32) {
    let all = params.vertices;
    for (var v = lane; v < all; v += LANES) {
        work[v] = x[v];
        move_by(v, p[v].xyz);
    }
    storageBarrier();
    workgroupBarrier();
    for (var index = 0u; index < params.substeps; index++) {
        let now = substeps[index];
        for (var v = lane; v < all; v += LANES) {
            if work[v].w != 0.0 {
                move_by(v, predict_displacement(moved(v), now));
            } else if params.pins == 0u {
                move_by(v, vec3f());
            }
        }
        for (var k = lane; k < params.pins; k += LANES) {
            let pin = pins[k];
            move_by(pin.vertex, pin_displacement(pin, work[pin.vertex].xyz, now));
        }
        workgroupBarrier();
        for (var sweep = 0u; sweep < params.sweeps; sweep++) {
            // Two of a colour ahead: more than a lane has in a cloth of 2048 vertices and as many lanes as can be.
            var next = hold(0u, lane);
            var after = hold(0u, lane + LANES);
            for (var color = 0u; color < COLORS; color++) {
                let held = next;
                let held_after = after;
                next = hold(color + 1u, lane);
                after = hold(color + 1u, lane + LANES);
                correct(held);
                correct(held_after);
                let width = width_of(color);
                for (var k = lane + 2u * LANES; k < width; k += LANES) {
                    correct(hold(color, k));
                }
                workgroupBarrier();
            }
        }
        for (var v = lane; v < all; v += LANES) {
            let w = work[v].w;
            var path = Path(work[v].xyz, moved(v));
            if w > 0.0 {
                for (var body = 0u; body < params.bodies; body++) {
                    path = contact_body(path.x, path.u, bodies[body], now);
                }
            }
            work[v] = vec4f(path.x + path.u, w);
            move_by(v, path.u);
        }
        storageBarrier();
        workgroupBarrier();
    }
    for (var v = lane; v < all; v += LANES) {
        if !(is_bounded(work[v].xyz) && is_bounded(moved(v))) {
            atomicMin(&first_bad, v);
        }
    }
    storageBarrier();
    workgroupBarrier();
    if atomicLoad(&first_bad) != NONE {
        return;
    }
    for (var v = lane; v < all; v += LANES) {
        x[v] = work[v];
        p[v] = vec4f(moved(v), params.h);
    }
}
