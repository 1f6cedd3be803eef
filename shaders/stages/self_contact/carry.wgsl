// Cloth that is carried by what runs over it.

// A pair is run over, too, if its distance shrinks to less than this share of it, and to less than truncation keeps.
const CLOSER: f32 = 0.5;
// A pair is also run over if its distance shrinks at all, and to less than this share of the thickness.
const CLOSEST: f32 = 0.004;

const LANES: u32 = 256u;
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
// whether it has moved through each other.
struct Passed {
    is_edge: bool,
    v: vec4u,
    start: Four,
    end: Four,
    is_flat: bool,
    is_through: bool,
}

fn passed_pair(marked: vec4u) -> Passed {
    let is_edge = (marked.x & MARK) != 0u;
    let v = marked & vec4u(~MARK);
    let start = positions(v);
    let end = Four(end_of(v.x), end_of(v.y), end_of(v.z), end_of(v.w));
    let is_flat = volume(start) * volume(end) <= 0.0;
    var is_through = false;
    if is_flat {
        is_through = moves_through(is_edge, start, end);
    }
    return Passed(is_edge, v, start, end, is_flat, is_through);
}

fn is_run_over(pair: Passed) -> bool {
    if pair.is_through {
        return true;
    }
    let before = distance_of(pair.is_edge, pair.start);
    let after = distance_of(pair.is_edge, pair.end);
    let is_close = after < CLEARANCE * contact_params.thickness && after < CLOSER * before;
    return is_close || (after < CLOSEST * contact_params.thickness && after < before);
}

// Whether a vertex is around what crosses, which would not separate if it were carried.
fn is_entangled(v: u32) -> bool {
    return is_among(vec2u(v, 0u), contact_params.ignored + contact_params.ignored_edges, contact_params.entangled);
}

// Finds out whether a pair is run over, and which corners are to be carried by which. A corner without a weight is not
// where the pair is closest.
fn run_over(pair: Passed) -> RunOver {
    if is_entangled(pair.v.x) || is_entangled(pair.v.y) || is_entangled(pair.v.z) || is_entangled(pair.v.w) || !is_run_over(pair) {
        return RunOver(NONE, vec4<bool>());
    }
    let is_edge = pair.is_edge;
    let v = pair.v;
    let start = pair.start;
    let weights = closest(is_edge, start);
    let apart = between(weights, start);
    let is_first = vec4<bool>(true, is_edge, false, false);
    let is_kinematic = vec4f(vertices[v.x].x.w, vertices[v.y].x.w, vertices[v.z].x.w, vertices[v.w].x.w) <= vec4f();
    let may_follow = (weights != vec4f()) & !is_kinematic;
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

// Stops the step if near pairs were not found for vertices that are carried as far as this one moves.
fn stop_if_far(leader: u32) {
    if leader != NONE {
        let travel = length(way_with(leader, vec3f()));
        if travel > contact_params.max_carry {
            atomicMax(&contact_state.status.needed_carry, bitcast<u32>(travel));
            atomicOr(&contact_state.status.stopped, RUN_OVER);
        }
    }
}

// Carries vertices of pairs, after truncation. If a vertex is in several pairs that are run over, the kinematic vertex with the
// highest index carries it.
@compute @workgroup_size(LANES)
fn carry(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        atomicStore(&carried, 0u);
        total = select(atomicLoad(&contact_state.status.passed), 0u, has_stopped());
    }
    // Pairs may stop the step, so all invocations must have the same number of them.
    let count = workgroupUniformLoad(&total);
    for (var k = lane; k < count; k += LANES) {
        let marked = pairs[place_of_passed(k)].corners;
        let found = run_over(passed_pair(marked));
        stop_if_far(found.leader);
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
        let all = atomicLoad(&carried);
        atomicStore(&contact_state.status.again, all);
        if all > 0u {
            atomicStore(&contact_state.status.passed, 0u);
        }
    }
}

// Moves a vertex like its leader, if it has one. Until the end of the substep its inverse mass is negative.
fn follow_leader(v: u32) {
    if v >= contact_params.vertices {
        return;
    }
    let leader = atomicExchange(&sums[SUMS * v + LEADER], 0);
    if leader > 0 {
        vertices[v].x.w = -abs(vertices[v].x.w);
        vertices[v].u = vec4f(vertices[u32(leader) - 1u].u.xyz, vertices[v].u.w);
        vertices[v].push = vec4f();
        vertices[v].way = vec4f(without_turning(way_with(v, vec3f())), vertices[v].way.w);
        atomicAdd(&carried, 1u);
    }
}

// Finds the pinched pairs among those whose plane has passed a vertex.
@compute @workgroup_size(LANES)
fn find_pinched(@builtin(local_invocation_index) lane: u32) {
    let count = atomicLoad(&contact_state.status.passed);
    for (var k = lane; k < count; k += LANES) {
        let marked = pairs[place_of_passed(k)].corners;
        let pair = passed_pair(marked);
        if contact_params.max_carry == 0.0 {
            stop_if_far(run_over(pair).leader);
        }
        if pair.is_through {
            let at = atomicAdd(&contact_state.status.through, 1u);
            if at < PINCHED {
                contact_state.through[at] = marked;
            }
        } else if pair.is_flat {
            let at = atomicAdd(&contact_state.status.pinched, 1u);
            if at < PINCHED {
                contact_state.pinched[at] = marked;
            }
        }
    }
    workgroupBarrier();
    if lane == 0u {
        atomicStore(&contact_state.status.passed, 0u);
    }
}
