// A step of a cloth that is one tile, in one workgroup: every substep, and at the end the commit.
// Displacements stay in workgroup memory throughout, those of a substep being the last ones of the next.

// Vectors in workgroup memory: one for each vertex, four for each aggregate.
override VECTORS: u32 = 64u;

@group(1) @binding(1) var<storage, read> substeps: array<Substep>;
@group(1) @binding(2) var<storage, read> pins: array<Pin>;
@group(1) @binding(3) var<storage, read> bodies: array<Body>;
@group(1) @binding(4) var<storage, read_write> x: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> p: array<vec4f>;
// Of vertices: positions and inverse masses, then, while the levels are swept, displacements; then what forces keep.
@group(1) @binding(6) var<storage, read_write> state: array<vec4f>;
@group(1) @binding(7) var<storage, read_write> found: Defects;

// Displacements of the vertices, and nothing beside: room for 4096 of them in 48 KiB. While the levels are swept it is
// theirs: centers, displacements as corrected and as predicted, and inverse masses. Arrays of three numbers are not padded to
// four as vectors are.
var<workgroup> vectors: array<array<f32, 3>, VECTORS>;

fn vector_at(k: u32) -> vec3f {
    let numbers = vectors[k];
    return vec3f(numbers[0], numbers[1], numbers[2]);
}

fn set_vector(k: u32, value: vec3f) {
    vectors[k] = array<f32, 3>(value.x, value.y, value.z);
}

fn displacement(v: u32) -> vec3f {
    return vector_at(v);
}

fn set_displacement(v: u32, u: vec3f) {
    set_vector(v, u);
}

fn center_of(k: u32) -> vec4f {
    return vec4f(vector_at(k), vectors[3u * AGGREGATES + k][0]);
}

fn set_center(k: u32, x: vec3f) {
    set_vector(k, x);
}

fn corrected_of(k: u32) -> vec3f {
    return vector_at(AGGREGATES + k);
}

fn set_corrected(k: u32, u: vec3f) {
    set_vector(AGGREGATES + k, u);
}

fn predicted_of(k: u32) -> vec3f {
    return vector_at(2u * AGGREGATES + k);
}

fn set_predicted(k: u32, u: vec3f) {
    set_vector(2u * AGGREGATES + k, u);
}

fn below(v: u32) -> Item {
    return Item(state[v].xyz, state[params.vertices + v].xyz);
}

// Behind the levels: the aggregates' inverse masses.
fn inverse_mass(k: u32) -> u32 {
    return table[coarse_edges().start + 3u * COARSE_WIDTH * COARSE_COLORS + k];
}

var<private> on_levels: bool;

fn correct(edge: Edge) {
    if on_levels {
        correct_coarse(edge);
        return;
    }
    let x_a = state[edge.a];
    let x_b = state[edge.b];
    let u_a = displacement(edge.a);
    let u_b = displacement(edge.b);
    let impulse = edge_impulse(x_a.xyz - x_b.xyz, u_a - u_b, edge);
    set_displacement(edge.a, u_a + impulse * x_a.w);
    set_displacement(edge.b, u_b - impulse * x_b.w);
}

// What lanes wrote to `state` is there for all.
fn meet_at_state() {
    storageBarrier();
    workgroupBarrier();
}

// Corrects what was predicted on the coarse levels. `skipped` is `first_in_use()`.
fn correct_on_levels(skipped: u32, lane: u32) {
    let all = params.vertices;
    let first = fetch_four(edges_in_use(skipped), 0u, lane);
    for (var v = lane; v < all; v += LANES) {
        state[all + v] = vec4f(displacement(v), 0.0);
    }
    meet_at_state();
    for (var k = lane; k < AGGREGATES; k += LANES) {
        vectors[3u * AGGREGATES + k][0] = bitcast<f32>(inverse_mass(k));
    }
    workgroupBarrier();
    on_levels = true;
    restrict_levels(lane);
    sweep_levels(skipped, first, lane);
    on_levels = false;
    for (var k = lane; k < FINEST; k += LANES) {
        set_corrected(k, corrected_of(k) - predicted_of(k));
    }
    workgroupBarrier();
    for (var v = lane; v < all; v += LANES) {
        state[all + v] += vec4f(corrected_of(label_at(0u, v)), 0.0);
    }
    workgroupBarrier();
    for (var v = lane; v < all; v += LANES) {
        set_displacement(v, state[all + v].xyz);
    }
    workgroupBarrier();
}

fn position_at(k: u32) -> vec3f {
    return state[k].xyz;
}

@compute @workgroup_size(LANES)
fn step_in_workgroup(@builtin(local_invocation_index) lane: u32) {
    let all = params.vertices;
    for (var v = lane; v < all; v += LANES) {
        state[v] = x[v];
        set_displacement(v, p[v].xyz);
    }
    meet_at_state();
    var skipped = 0u;
    if LEVELS > 0u {
        skipped = first_in_use();
    }
    for (var index = 0u; index < params.substeps; index++) {
        let now = substeps[index];
        gather_forces(lane, now);
        for (var v = lane; v < all; v += LANES) {
            if state[v].w != 0.0 {
                set_displacement(v, pushed(v, predict_displacement(displacement(v), now), now));
            } else if params.pins == 0u {
                set_displacement(v, vec3f());
            }
        }
        for (var k = lane; k < params.pins; k += LANES) {
            let pin = pins[k];
            set_displacement(pin.vertex, pin_displacement(pin, state[pin.vertex].xyz, now));
        }
        workgroupBarrier();
        if LEVELS > 0u && params.levels > 0u {
            correct_on_levels(skipped, lane);
        }
        for (var time = 0u; time < params.sweeps; time++) {
            sweep(edges_of(0u), fetch_four(edges_of(0u), 0u, lane), lane);
        }
        for (var v = lane; v < all; v += LANES) {
            let x_v = state[v];
            let path = after_contact(v, x_v, displacement(v), now);
            state[v] = vec4f(path.x + path.u, x_v.w);
            set_displacement(v, path.u);
        }
        meet_at_state();
    }
    if found.stopped == 0u {
        for (var v = lane; v < all; v += LANES) {
            check_vertex(v, state[v].xyz, displacement(v), state[v].w);
        }
        check_edges(0u, IN_TABLE, lane);
    }
    meet_at_state();
    let failed = has_failed();
    meet_at_state();
    if lane == 0u {
        end_of_watch();
    }
    if failed {
        return;
    }
    for (var v = lane; v < all; v += LANES) {
        x[v] = state[v];
        p[v] = vec4f(displacement(v), params.h);
    }
}
