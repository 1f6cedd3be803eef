// Bending and prediction for a tile of vertices, with all passes in one dispatch. Besides its own vertices, the
// workgroup holds a halo: the rings around them on which they depend through the passes. It recomputes the halo without
// storing it. At the halo's outermost vertices, contributions from beyond it are missing; the error is too far away to
// reach the tile's own vertices.

// Invocations per workgroup, vertices that a tile has room for, numbers in workgroup memory, and whether there are
// several passes; the last pass is marked by its `last`.
override LANES: u32 = 64u;
override ROOM: u32 = 64u;
override NUMBERS: u32 = 384u;
override FILTERED: bool = false;

@group(1) @binding(4) var<storage, read> rows: array<BendRow>;
@group(1) @binding(5) var<storage, read> spans: array<Span>;
@group(1) @binding(6) var<storage, read> entries: array<BendEntry>;
// For each tile, the number of its own vertices, the number of vertices that it holds, and where they are listed. The
// list has for each vertex, own ones first, its index and where its neighbors are listed; those are positions in this
// list, in the order of the vertex's entries, or NO_PLACE if not held.
@group(1) @binding(7) var<storage, read> table: array<u32>;
@group(1) @binding(8) var<uniform> bend_passes: array<BendPass, 16>;

const NO_PLACE: u32 = 0xffffffffu;

var<workgroup> numbers: array<f32, NUMBERS>;

// Positions of a vertex's vectors in workgroup memory: moment (pull) and couple always, the others only with several
// passes.
fn pull_of(k: u32) -> u32 {
    return 3u * k;
}

fn couple_at(k: u32) -> u32 {
    return 3u * (ROOM + k);
}

fn curvature_of(k: u32) -> u32 {
    return 3u * (2u * ROOM + k);
}

fn change_of(k: u32) -> u32 {
    return 3u * (3u * ROOM + k);
}

fn way_of(k: u32) -> u32 {
    return 3u * (4u * ROOM + k);
}

fn resisted_of(k: u32) -> u32 {
    return 3u * (5u * ROOM + k);
}

fn vector_at(at: u32) -> vec3f {
    return vec3f(numbers[at], numbers[at + 1u], numbers[at + 2u]);
}

fn set_vector(at: u32, value: vec3f) {
    numbers[at] = value.x;
    numbers[at + 1u] = value.y;
    numbers[at + 2u] = value.z;
}

fn first_moment(v: u32, k: u32) {
    let x_v = x[v].xyz;
    var ring = Ring();
    for (var e = spans[v].start; e < spans[v].end; e++) {
        let entry = entries[e];
        let d = x[entry.other].xyz - x_v;
        if params.damped == 0u {
            ring.y += d * entry.forward;
        } else if entry.forward != 0.0 {
            add_neighbor(&ring, d, (p[entry.other].xyz - p[v].xyz) * substep.rate, entry.forward);
        }
    }
    let stiffness = rows[v].stiffness;
    let damping = stiffness * rows[v].tau;
    if !FILTERED {
        let moment = bend_moment(ring, stiffness, damping);
        set_vector(pull_of(k), moment.pull);
        set_vector(couple_at(k), moment.couple);
        return;
    }
    let resisted = bend_moment(ring, 0.0, damping);
    let passed = next_moment(vec3f(), vec3f(), ring.y, stiffness, bend_passes[0]);
    set_vector(pull_of(k), passed.moment);
    set_vector(couple_at(k), resisted.couple);
    set_vector(curvature_of(k), ring.y);
    set_vector(change_of(k), passed.change);
    set_vector(resisted_of(k), resisted.pull);
}

fn give_way(v: u32, k: u32, places: u32, bend_pass: BendPass) {
    let first = spans[v].start;
    var force = vector_at(pull_of(k)) * rows[v].diagonal;
    for (var e = first; e < spans[v].end; e++) {
        let place = table[places + e - first];
        if place != NO_PLACE {
            force += vector_at(pull_of(place)) * entries[e].backward;
        }
    }
    set_vector(way_of(k), force * (x[v].w * bend_pass.way));
}

fn bend_again(v: u32, k: u32, places: u32, bend_pass: BendPass) {
    let first = spans[v].start;
    let own = vector_at(way_of(k));
    var bent = vector_at(curvature_of(k));
    for (var e = first; e < spans[v].end; e++) {
        let place = table[places + e - first];
        if place != NO_PLACE {
            bent += (vector_at(way_of(place)) - own) * entries[e].forward;
        }
    }
    let passed = next_moment(vector_at(pull_of(k)), vector_at(change_of(k)), bent, rows[v].stiffness, bend_pass);
    if bend_pass.last == 0u {
        set_vector(pull_of(k), passed.moment);
        set_vector(change_of(k), passed.change);
    } else {
        set_vector(pull_of(k), passed.moment + vector_at(resisted_of(k)));
    }
}

fn bend_force(v: u32, k: u32, places: u32) -> vec3f {
    let first = spans[v].start;
    let own = vector_at(couple_at(k));
    var force = -vector_at(pull_of(k)) * rows[v].diagonal;
    for (var e = first; e < spans[v].end; e++) {
        let entry = entries[e];
        let place = table[places + e - first];
        force -= vector_at(pull_of(place)) * entry.backward;
        if params.damped != 0u {
            force -= cross(couple_of(own, vector_at(couple_at(place)), entry), x[entry.other].xyz - x[v].xyz);
        }
    }
    return force;
}

@compute @workgroup_size(LANES)
fn bend_tile(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    // A single dimension suffices for the largest possible number of tiles.
    let tile = group.x;
    let own = table[3u * tile];
    let held = table[3u * tile + 1u];
    let list = table[3u * tile + 2u];
    for (var k = lane; k < held; k += LANES) {
        first_moment(table[list + 2u * k], k);
    }
    workgroupBarrier();
    for (var index = 1u; FILTERED && bend_passes[index - 1u].last == 0u; index++) {
        for (var k = lane; k < held; k += LANES) {
            give_way(table[list + 2u * k], k, table[list + 2u * k + 1u], bend_passes[index]);
        }
        workgroupBarrier();
        for (var k = lane; k < held; k += LANES) {
            bend_again(table[list + 2u * k], k, table[list + 2u * k + 1u], bend_passes[index]);
        }
        workgroupBarrier();
    }
    for (var k = lane; k < own; k += LANES) {
        let v = table[list + 2u * k];
        predict_item(v);
        if x[v].w != 0.0 {
            u[v] += vec4f(bend_force(v, k, table[list + 2u * k + 1u]) * (x[v].w * substep.gain), 0.0);
        }
    }
    if tile == 0u {
        for (var pin = lane; pin < params.pins; pin += LANES) {
            predict_item(params.vertices + pin);
        }
    }
}
