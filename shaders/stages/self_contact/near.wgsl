// Selects the pairs of the list that may touch in this substep.

const FINDERS: u32 = 256u;

// A pair acts if it comes closer than its thickness plus this multiple of it.
const ACTING: f32 = 0.3;
// How much earlier `glance` considers a pair as near, as a multiple of the thickness.
const ROUNDING_MARGIN: f32 = 1e-3;

// Numbers of pairs that a workgroup finds, and where they begin: those that truncation alone holds, and those that act.
var<workgroup> found: array<atomic<u32>, 2>;
var<workgroup> firsts: array<u32, 2>;

// The closest points of a listed pair, and how close these can come in this substep.
struct Closest {
    weights: vec4f,
    apart: vec3f,
    left: f32,
}

fn closest_of(at: Four, is_edge: bool, u: Four, mean: vec3f, pushed: f32) -> Closest {
    // A vertex that is carried may move farther.
    let least = contact_params.max_carry * contact_params.max_carry;
    let travel = max(vec4f(least), vec4f(
        square(u.a - mean - by_turning(at.a)),
        square(u.b - mean - by_turning(at.b)),
        square(u.c - mean - by_turning(at.c)),
        square(u.d - mean - by_turning(at.d)),
    ));
    let weights = closest(is_edge, at);
    let apart = between(weights, at);
    return Closest(weights, apart, length(apart) - sum_of_sides(is_edge, sqrt(travel)) - 2.0 * pushed);
}

// Used instead of the response while pairs are listed but none is near: stops the step if one may be. The margin covers
// rounding, because kernels may round differently.
@compute @workgroup_size(WORKGROUP)
fn glance(me: Invocation, group: Workgroup) {
    let all = listed_pairs(me.lane);
    if all == 0u {
        return;
    }
    let mean = mean_of_parts(me.lane);
    let pushed = max(contact_state.status.pushed, bitcast<f32>(atomicLoad(&contact_state.status.most_push)));
    for (var k = item(me.id, group.all); k < all; k += stride(group.all)) {
        let pair = pairs[place(k)];
        let is_edge = k >= with_vertices;
        let closest = closest_of(positions(pair.corners), is_edge, displacements(pair.corners), mean, pushed);
        if !(closest.left > reach(is_edge, pair.thickness, pair.corners) + ROUNDING_MARGIN * contact_params.thickness) {
            atomicOr(&contact_state.status.stopped, CLOSE);
        }
    }
}

// The coefficient of friction of a pair: that of a mesh collider, whose vertices are the last, or the cloth's.
fn friction_of(corners: vec4u) -> f32 {
    let v = max(corners.x, corners.w);
    if v < contact_params.vertices {
        return contact_params.friction;
    }
    return vertices[v].push.w;
}

// A listed pair in this substep. `state` is 0 if it is not near, 1 if only truncation holds it, and 2 if it acts.
struct Proximity {
    pair: Near,
    state: u32,
}

fn proximity_of(k: u32) -> Proximity {
    let pair = pairs[place(k)];
    let is_edge = k >= with_vertices;
    let u = displacements(pair.corners);
    let at = positions(pair.corners);
    let closest = closest_of(at, is_edge, u, contact_state.status.mean, contact_state.status.pushed);
    let weights = closest.weights;
    let distance = length(closest.apart);
    var normal = closest.apart / max(distance, 1e-12);
    if is_tilted(distance, pair.thickness, at, is_edge) {
        let exact = perpendicular(closest.apart, weights, at, is_edge);
        // A vector that all but vanishes is noise.
        let size = length(exact);
        normal = select(normal, exact / size, size > 0.5 * distance);
    }
    var state = 0u;
    // A vector of no length has no direction.
    if closest.left < reach(is_edge, pair.thickness, pair.corners) && distance > 1e-12 {
        let gap = distance - pair.thickness + dot(normal, between(weights, u));
        // If the closest point is an end of an edge, a vertex-triangle pair acts there instead.
        let inner = weights.y > 0.0 && weights.y < 1.0 && weights.w < 0.0 && weights.w > -1.0;
        var acts = gap < ACTING * pair.thickness && (inner || !is_edge);
        // Above a side or a corner of its triangle, a vertex may be closer to another triangle.
        if acts && is_edge {
            acts = are_edges_closest(pair.corners, at, normal);
        } else if acts {
            acts = is_closest(pair.corners.x, pair.corners.yzw, weights.yzw, closest.apart);
        }
        state = select(1u, 2u, acts);
    }
    if state < 2u && any(pair.lambda != vec4f()) {
        pairs[place(k)].lambda = vec4f();
    }
    let friction = friction_of(pair.corners);
    return Proximity(Near(pair.corners, weights, normal, distance, pair.lambda, pair.thickness, 0.0, k, friction), state);
}

@compute @workgroup_size(FINDERS)
fn find(me: Invocation, group: Workgroup) {
    let all = listed_pairs(me.lane);
    for (var first = 0u; first < all; first += group.all.x * group.all.y * FINDERS) {
        if me.lane < 2u {
            atomicStore(&found[me.lane], 0u);
        }
        workgroupBarrier();
        let k = first + number_of(group) * FINDERS + me.lane;
        var proximity: Proximity;
        var rank = 0u;
        if k < all {
            proximity = proximity_of(k);
            if proximity.state > 0u {
                rank = atomicAdd(&found[proximity.state - 1u], 1u);
            }
        }
        workgroupBarrier();
        // Two invocations, because each must wait for an answer.
        if me.lane == 0u {
            firsts[0] = atomicAdd(&contact_state.status.near, atomicLoad(&found[0]));
        } else if me.lane == 32u {
            firsts[1] = atomicAdd(&contact_state.status.acting, atomicLoad(&found[1]));
        }
        workgroupBarrier();
        if proximity.state > 0u {
            set_near(place_of(proximity.state, firsts[proximity.state - 1u] + rank), proximity.pair);
        }
        if proximity.state == 2u {
            let units = vec4i(round(abs(proximity.pair.weights) * UNIT_WEIGHT));
            for (var c = 0u; c < 4u; c++) {
                // The vertices of mesh colliders have no sums.
                let v = proximity.pair.corners[c];
                if v < contact_params.vertices {
                    atomicAdd(&sums[SUMS * v + WEIGHT], units[c]);
                }
            }
        }
    }
}
