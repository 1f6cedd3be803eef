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

// An edge as it is stored, and where its ends are: neither changes while edges are swept, or is looked into before its turn.
struct Held {
    stored: Stored,
    x_a: vec4f,
    x_b: vec4f,
}

fn hold(stored: Stored) -> Held {
    return Held(stored, work[stored.ends & 0xffffu], work[stored.ends >> 16u]);
}

fn correct(held: Held, k: u32) {
    if !is_edge(held.stored, k) {
        return;
    }
    let edge = edge_of(held.stored);
    let d0 = held.x_a.xyz - held.x_b.xyz;
    let u_a = moved(edge.a);
    let u_b = moved(edge.b);
    var impulse: vec3f;
    if params.relaxed != 0u {
        impulse = relax_edge(d0, u_a - u_b, edge);
    } else {
        impulse = project_edge(d0, u_a - u_b, edge);
    }
    move_by(edge.a, u_a + impulse * held.x_a.w);
    move_by(edge.b, u_b - impulse * held.x_b.w);
}

// A colour's edges: the lane's first two, and those that it has beside.
fn sweep(color: u32, first: Held, second: Held, lane: u32) {
    correct(first, lane);
    correct(second, lane + LANES);
    for (var k = lane + 2u * LANES; k < WIDTH; k += LANES) {
        correct(hold(fetch(0u, color, k)), k);
    }
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
        for (var time = 0u; time < params.sweeps; time++) {
            // A lane's first two edges of the next colour, and where their ends are, are under way while one is swept.
            // Odd colours have other names than even ones, for to move one to another would be to wait for it.
            var even = fetch(0u, 0u, lane);
            var even_too = fetch(0u, 0u, lane + LANES);
            var odd = fetch(0u, 1u, lane);
            var odd_too = fetch(0u, 1u, lane + LANES);
            var even_held = hold(even);
            var even_held_too = hold(even_too);
            for (var color = 0u; color < COLORS; color += 2u) {
                let odd_held = hold(odd);
                let odd_held_too = hold(odd_too);
                even = fetch(0u, color + 2u, lane);
                even_too = fetch(0u, color + 2u, lane + LANES);
                sweep(color, even_held, even_held_too, lane);
                workgroupBarrier();
                if color + 1u < COLORS {
                    even_held = hold(even);
                    even_held_too = hold(even_too);
                    odd = fetch(0u, color + 3u, lane);
                    odd_too = fetch(0u, color + 3u, lane + LANES);
                    sweep(color + 1u, odd_held, odd_held_too, lane);
                    workgroupBarrier();
                }
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
