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

fn correct(edge: Edge) {
    let x_a = work[edge.a];
    let x_b = work[edge.b];
    let u_a = moved(edge.a);
    let u_b = moved(edge.b);
    var impulse: vec3f;
    if params.relaxed != 0u {
        impulse = relax_edge(x_a.xyz - x_b.xyz, u_a - u_b, edge);
    } else {
        impulse = project_edge(x_a.xyz - x_b.xyz, u_a - u_b, edge);
    }
    move_by(edge.a, u_a + impulse * x_a.w);
    move_by(edge.b, u_b - impulse * x_b.w);
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
            for (var color = 0u; color < COLORS; color++) {
                sweep(0u, color, fetch(0u, color, lane), lane);
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
