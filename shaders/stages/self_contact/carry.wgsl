// Cloth that is carried by what runs over it.

// A pair is run over, too, if its distance shrinks to less than this share of it, and to less than truncation keeps.
const CLOSER: f32 = 0.5;
// How deep truncation may leave a vertex in a collider, in units of the thickness, before the collider carries it.
const SUNK: f32 = 0.1;

override LANES: u32 = 256u;
// The sum of weights, which is free after the response (`finish` has cleared it): 1 + the vertex that carries this one.
const LEADER: u32 = 0u;

// Number of vertices that are carried.
var<workgroup> carried: atomic<u32>;

// Which corners of a pair are to be carried by a kinematic vertex; none if all are kinematic.
struct RunOver {
    leader: u32,
    followers: vec4<bool>,
}

// A pair whose plane has passed a vertex: whether it is one of two edges, its vertices, where they start and end, and
// whether its features have met and whether it has moved through each other.
struct Passed {
    is_edge: bool,
    v: vec4u,
    start: Four,
    end: Four,
    is_flat: bool,
    has_met: bool,
    is_through: bool,
}

fn passed_pair(marked: vec4u) -> Passed {
    let is_edge = (marked.x & MARK) != 0u;
    let v = marked & vec4u(~MARK);
    let start = positions(v);
    let end = Four(end_of(v.x), end_of(v.y), end_of(v.z), end_of(v.w));
    let is_flat = volume(start) * volume(end) <= 0.0;
    var has_met = false;
    if is_flat {
        has_met = meets(is_edge, start, end);
    }
    return Passed(is_edge, v, start, end, is_flat, has_met, has_met && has_sides(is_edge, start, end));
}

// Whether anything crosses around a pair.
fn is_pair_entangled(v: vec4u) -> bool {
    return is_entangled(v.x) || is_entangled(v.y) || is_entangled(v.z) || is_entangled(v.w);
}

fn is_run_over(pair: Passed) -> bool {
    if pair.is_through {
        return true;
    }
    let after = distance_of(pair.is_edge, pair.end);
    return after < CLEARANCE * contact_params.thickness && after < CLOSER * distance_of(pair.is_edge, pair.start);
}

// Whether a vertex is around what crosses, which would not separate if it were carried.
fn is_entangled(v: u32) -> bool {
    var low = contact_params.ignored + contact_params.ignored_edges;
    var high = low + contact_params.entangled;
    while low < high {
        let middle = (low + high) / 2u;
        if ignored[middle].x == v {
            return true;
        }
        low = select(low, middle + 1u, ignored[middle].x < v);
        high = select(high, middle, ignored[middle].x > v);
    }
    return false;
}

// Finds out whether a pair is run over, and which corners are to be carried by which. A corner without a weight is not
// where the pair is closest.
fn run_over(pair: Passed) -> RunOver {
    if is_pair_entangled(pair.v) || !is_run_over(pair) {
        return RunOver(NONE, vec4<bool>());
    }
    let is_edge = pair.is_edge;
    let v = pair.v;
    let start = pair.start;
    var weights = vertex_triangle(start);
    if is_edge {
        weights = edge_edge(start);
    }
    let apart = between(weights, start);
    let is_first = vec4<bool>(true, is_edge, false, false);
    let is_kinematic = vec4f(vertices[v.x].x.w, vertices[v.y].x.w, vertices[v.z].x.w, vertices[v.w].x.w) <= vec4f();
    let may_follow = weights != vec4f() & !is_kinematic;
    var found = RunOver(NONE, vec4<bool>());
    var most = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let followers = may_follow & (is_first != vec4<bool>(is_first[k]));
        if is_kinematic[k] && any(followers) {
            let towards = dot(vertices[v[k]].u.xyz, select(apart, -apart, is_first[k]));
            if found.leader == NONE || towards > most {
                found = RunOver(v[k], followers);
                most = towards;
            }
        }
    }
    return found;
}

// Stops the step if near pairs were not found for vertices that are carried so far besides the common motion [m].
fn stop_if_far(travel: f32) {
    if travel > contact_params.max_carry {
        atomicMax(&contact_state.status.needed_carry, bitcast<u32>(travel));
        atomicOr(&contact_state.status.stopped, RUN_OVER);
    }
}

fn stop_if_leader_is_far(leader: u32) {
    if leader != NONE {
        stop_if_far(length(way_with(leader, vec3f())));
    }
}

// Carries vertices that sink into a collider, because pairs have moved them or truncation has shortened their displacements,
// with the collider's surface.
@compute @workgroup_size(WORKGROUP)
fn carry_sinking(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= contact_params.vertices || has_stopped() {
        return;
    }
    let x = vertices[i].x;
    if x.w <= 0.0 || vertices[i].push.w == 0.0 || is_entangled(i) {
        return;
    }
    let way = vertices[i].u.xyz + vertices[i].push.xyz;
    for (var k = 0u; k < contact_params.bodies; k++) {
        let contact = contact_point(x.xyz, way, bodies[k], substep);
        if contact.after < -SUNK * contact_params.thickness && contact.after < contact.before {
            carry_by(i, contact.step);
            // Also without `max_carry`, so that the step is repeated with what truncates again.
            stop_if_far(max(length(way_with(i, vec3f())), SUNK * contact_params.thickness));
            atomicAdd(&contact_state.status.sinking, 1u);
            return;
        }
    }
}

// Until the end of the substep the inverse mass of a vertex that is carried is negative.
fn carry_by(v: u32, u: vec3f) {
    vertices[v].x.w = -abs(vertices[v].x.w);
    vertices[v].u = vec4f(u, vertices[v].u.w);
    vertices[v].push = vec4f();
    vertices[v].way = vec4f(without_turning(way_with(v, vec3f())), vertices[v].way.w);
}

// Carries vertices of pairs, after truncation. If a vertex is in several pairs that are run over, the kinematic vertex with the
// highest index carries it.
@compute @workgroup_size(LANES)
fn carry(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        atomicStore(&carried, 0u);
    }
    let count = select(atomicLoad(&contact_state.status.passed), 0u, has_stopped());
    for (var k = lane; k < count; k += LANES) {
        let marked = pairs[place_of_passed(k)].corners;
        let found = run_over(passed_pair(marked));
        stop_if_leader_is_far(found.leader);
        for (var c = 0u; c < 4u; c++) {
            if found.followers[c] {
                atomicMax(&sums[SUMS * (marked[c] & ~MARK) + LEADER], i32(found.leader + 1u));
            }
        }
    }
    workgroupBarrier();
    storageBarrier();
    for (var k = lane; k < count; k += LANES) {
        for (var c = 0u; c < 4u; c++) {
            follow_leader(pairs[place_of_passed(k)].corners[c] & ~MARK);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        let sinking = atomicExchange(&contact_state.status.sinking, 0u);
        contact_state.status.carried_by_colliders += sinking;
        let all = atomicLoad(&carried) + sinking;
        atomicStore(&contact_state.status.again, all);
        if all > 0u {
            atomicStore(&contact_state.status.passed, 0u);
        }
    }
}

// Moves a vertex like its leader, if it has one.
fn follow_leader(v: u32) {
    if v >= contact_params.vertices {
        return;
    }
    let leader = atomicExchange(&sums[SUMS * v + LEADER], 0);
    if leader > 0 {
        carry_by(v, vertices[u32(leader) - 1u].u.xyz);
        atomicAdd(&carried, 1u);
    }
}

// Finds the pinched pairs among those whose plane has passed a vertex. The second corner of those that have moved through
// each other is marked, and the first of two edges. Stops the step if colliders have carried vertices, and a pair is run over
// nevertheless.
@compute @workgroup_size(LANES)
fn find_pinched(@builtin(local_invocation_index) lane: u32) {
    let count = atomicLoad(&contact_state.status.passed);
    for (var k = lane; k < count; k += LANES) {
        let marked = pairs[place_of_passed(k)].corners;
        let pair = passed_pair(marked);
        if contact_params.max_carry == 0.0 {
            stop_if_leader_is_far(run_over(pair).leader);
        }
        if contact_state.status.carried_by_colliders > 0u && (pair.has_met || is_run_over(pair)) && !is_pair_entangled(pair.v) {
            atomicOr(&contact_state.status.stopped, RUN_THROUGH);
        }
        if pair.is_flat {
            let at = atomicAdd(&contact_state.status.pinched, 1u);
            if at < PINCHED {
                contact_state.pinched[at] = vec4u(marked.x, pair.v.y | select(0u, MARK, pair.is_through), pair.v.zw);
            }
        }
    }
    workgroupBarrier();
    if lane == 0u {
        atomicStore(&contact_state.status.passed, 0u);
        contact_state.status.carried_by_colliders = 0u;
    }
}
