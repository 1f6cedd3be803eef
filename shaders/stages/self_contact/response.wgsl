// Computes the response that holds near pairs apart.
//
// Each iteration of the response is a dispatch over pairs, followed by one over vertices that applies the sums.

// Whether a workgroup collects the sums of its pairs, which share vertices, in its own memory first. That adds faster, but takes
// some time even if there is little to add.
override COLLECTS: bool = false;
// Whether an iteration is the last of the substep, which is not over-relaxed.
override IS_LAST: bool = false;
// Number of vertices for which a workgroup collects, and of places at which one is looked for.
const PLACES: u32 = 256u;
const PROBES: u32 = 8u;

// Limit on what a pair does at once, as the approach [thicknesses] that it may respond to. The sums of all pairs of a vertex wrap at
// 256 thicknesses; that would add momentum. The rest is left to the next iteration, and to truncation.
const MOST: f32 = 64.0;

// A hash table: the vertex at each place, or `NONE`, and three sums.
var<workgroup> owners: array<atomic<u32>, PLACES>;
var<workgroup> collected: array<atomic<i32>, 768>;

// Adds a vector [m] to three sums of a vertex.
fn add(v: u32, first: u32, by: vec3f) {
    let units = vec3i(round(by * (UNIT_LENGTH / contact_params.thickness)));
    if all(units == vec3i()) {
        return;
    }
    var at = NONE;
    if COLLECTS {
        at = place_for(v);
    }
    if at == NONE {
        add_units(v, first, units);
    } else {
        for (var k = 0u; k < 3u; k++) {
            atomicAdd(&collected[3u * at + k], units[k]);
        }
    }
}

// The place of a vertex in the table of this workgroup, or `NONE` if there is none left nearby.
fn place_for(v: u32) -> u32 {
    let first = (v * 0x9e3779b1u) >> 24u;
    for (var k = 0u; k < PROBES; k++) {
        let at = (first + k) % PLACES;
        if atomicLoad(&owners[at]) == NONE {
            atomicCompareExchangeWeak(&owners[at], NONE, v);
        }
        if atomicLoad(&owners[at]) == v {
            return at;
        }
    }
    return NONE;
}

// Empties the table.
fn begin_collecting(lane: u32) {
    if !COLLECTS {
        return;
    }
    for (var at = lane; at < PLACES; at += WORKGROUP) {
        atomicStore(&owners[at], NONE);
        for (var k = 0u; k < 3u; k++) {
            atomicStore(&collected[3u * at + k], 0);
        }
    }
    workgroupBarrier();
}

// Adds what was collected to three sums of each vertex, and empties the table.
fn end_collecting(first: u32, lane: u32) {
    if !COLLECTS {
        return;
    }
    workgroupBarrier();
    for (var at = lane; at < PLACES; at += WORKGROUP) {
        let v = atomicExchange(&owners[at], NONE);
        if v != NONE {
            var units: vec3i;
            for (var k = 0u; k < 3u; k++) {
                units[k] = atomicExchange(&collected[3u * at + k], 0);
            }
            add_units(v, first, units);
        }
    }
    workgroupBarrier();
}

// Adds an impulse [kg m] of a pair to three sums of each of its vertices.
fn add_impulse(corners: vec4u, w: vec4f, first: u32, weights: vec4f, by: vec3f) {
    let shares = weights * w;
    add(corners.x, first, by * shares.x);
    add(corners.y, first, by * shares.y);
    add(corners.z, first, by * shares.z);
    add(corners.w, first, by * shares.w);
}

// The vertices of mesh colliders have no sums, and need none because they have no inverse mass.
fn weight_of(v: u32) -> f32 {
    if v >= contact_params.vertices {
        return 0.0;
    }
    return f32(atomicLoad(&sums[SUMS * v + WEIGHT])) / UNIT_WEIGHT;
}

// Computes the relaxation rate of a pair, and its impulse for the warm start.
fn warm_start_pair(k: u32) {
    let n = near_at(k);
    let w = inverse_masses(n.corners);
    let bound = bound_of(n, w);
    if !(bound > 0.0) {
        set_lambda(k, vec4f());
        return;
    }
    let rate = RELAXATION / bound;
    set_rate(k, rate);
    var held = n.lambda * (warm_share(max(-room_of(n, w), 0.0), n.thickness) * contact_state.status.scale);
    held -= vec4f(n.normal * dot(n.normal, held.xyz), 0.0);
    let most = vec4f(MOST * contact_params.thickness * rate);
    held = clamp(held, -most, most);
    set_lambda(k, held);
    add_impulse(n.corners, w, IMPULSE, n.weights, impulse(Multipliers(held.xyz, held.w), n.normal));
}

// The bound on the relaxation of a pair [1/kg].
fn bound_of(n: Near, w: vec4f) -> f32 {
    let all = vec4f(weight_of(n.corners.x), weight_of(n.corners.y), weight_of(n.corners.z), weight_of(n.corners.w));
    let mobility = w * all * abs(n.weights);
    return (mobility.x + mobility.y) + (mobility.z + mobility.w);
}

// Adds the correction that separates a pair that is too close.
fn push_pair(k: u32) {
    let n = near_at(k);
    let w = inverse_masses(n.corners);
    let depth = separation(max(-room_of(n, w), 0.0), n.thickness, DEPENETRATION * params.h);
    if depth == 0.0 {
        return;
    }
    let bound = bound_of(n, w);
    if bound > 0.0 {
        add_impulse(n.corners, w, PUSHED, n.weights, n.normal * (depth / bound));
    }
}

@compute @workgroup_size(WORKGROUP)
fn warm_start(me: Invocation, group: Workgroup) {
    let acting = acting_pairs(me.lane);
    begin_collecting(me.lane);
    for (var first = number_of(group) * WORKGROUP; first < acting; first += stride(group.all)) {
        let k = first + me.lane;
        if k < acting {
            warm_start_pair(k);
        }
        end_collecting(IMPULSE, me.lane);
        if k < acting {
            push_pair(k);
        }
        end_collecting(PUSHED, me.lane);
    }
}

fn step_pair(k: u32) {
    let n = near_at(k);
    if n.rate == 0.0 {
        return;
    }
    let a = vertices[n.corners.x].u;
    let b = vertices[n.corners.y].u;
    let c = vertices[n.corners.z].u;
    let d = vertices[n.corners.w].u;
    let relative = between(n.weights, Four(a.xyz, b.xyz, c.xyz, d.xyz));
    let held = Multipliers(n.lambda.xyz, n.lambda.w);
    let rate = n.rate * select(1.0, 1.0 / RELAXATION, IS_LAST);
    let w = vec4f(a.w, b.w, c.w, d.w);
    let gap = max(room_of(n, w), 0.0);
    let wanted = step_of_lambda(held, n.normal, gap, relative, rate, n.friction);
    let most = vec4f(MOST * contact_params.thickness * rate);
    let now = clamp(vec4f(wanted.lambda_t, wanted.lambda_n), n.lambda - most, n.lambda + most);
    set_lambda(k, now);
    let more = now - n.lambda;
    add_impulse(n.corners, w, IMPULSE, n.weights, impulse(Multipliers(more.xyz, more.w), n.normal));
}

@compute @workgroup_size(WORKGROUP)
fn step_pairs(me: Invocation, group: Workgroup) {
    let acting = acting_pairs(me.lane);
    begin_collecting(me.lane);
    for (var first = number_of(group) * WORKGROUP; first < acting; first += stride(group.all)) {
        if first + me.lane < acting {
            step_pair(first + me.lane);
        }
        end_collecting(IMPULSE, me.lane);
    }
}

// Applies the impulses of its pairs to a vertex, and resolves its contact with the colliders. This begins without the colliders each
// time: computed from what is left of earlier impulses, a collider would keep what it has taken up of an impulse that is taken back in
// a later iteration, and return it as a velocity.
fn apply_sums(i: u32) {
    if vertices[i].x.w == 0.0 || atomicLoad(&sums[SUMS * i + WEIGHT]) == 0 {
        return;
    }
    let x = vertices[i].x.xyz;
    var u = vertices[i].way.xyz + summed(i, IMPULSE, UNIT_LENGTH);
    vertices[i].way = vec4f(u, vertices[i].way.w);
    for (var k = 0u; k < 3u; k++) {
        atomicStore(&sums[SUMS * i + IMPULSE + k], 0);
    }
    for (var k = 0u; k < contact_params.bodies; k++) {
        u = contact_body(path_of(x, u), bodies[k], substep).u;
    }
    vertices[i].u = vec4f(u, vertices[i].u.w);
}

// Also stores how far a vertex was about to move, before the first impulses.
@compute @workgroup_size(WORKGROUP)
fn apply_impulses_first(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= contact_params.vertices || is_idle() {
        return;
    }
    vertices[i].way.w = max(length(way_with(i, vertices[i].push.xyz)), contact_params.max_carry);
    apply_sums(i);
}

@compute @workgroup_size(WORKGROUP)
fn apply_impulses(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i < contact_params.vertices && !is_idle() {
        apply_sums(i);
    }
}

// Also applies the corrections, and limits how far a vertex moves beyond what it was about to. Of the sums, only the share is
// needed from here on.
@compute @workgroup_size(WORKGROUP)
fn apply_impulses_last(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= contact_params.vertices || is_idle() {
        return;
    }
    apply_sums(i);
    vertices[i].push = vec4f(vertices[i].push.xyz + summed(i, PUSHED, UNIT_LENGTH), 0.0);
    atomicStore(&sums[SUMS * i + SQUARES], 0);
    begin_truncation(i, vertices[i].way.w + allowance_of(i));
}
