// Truncates displacements: src/contact/contacts/truncation.rs has the theory.

// Whether displacements are truncated once more in a substep, because vertices slide or were carried.
override AGAIN: bool = false;
// Pairs are held in three rounds: those that are not clear, those that were until a corner was shortened, and then all if that
// has shortened others.
override ROUND: u32 = 0u;

// More than any height [m].
const FAR: f32 = 3e38;

// The number of pairs with a normal impulse that a workgroup counts.
var<workgroup> pressing: atomic<u32>;

// How far a vertex moves relative to the common motion, after the response. Vertices of mesh colliders are not corrected.
fn way_of(v: u32) -> vec3f {
    if v >= contact_params.vertices {
        return without_turning(way_with(v, vec3f()));
    }
    return vertices[v].way.xyz;
}

// Computes the shares of its vertices' displacements with which a pair stays on both sides of the plane halfway
// between.
fn truncate_pair(n: Near) {
    let sides = select(vec4f(1.0, -1.0, -1.0, -1.0), vec4f(1.0, 1.0, -1.0, -1.0), n.listed >= with_vertices);
    let firsts = max(sides, vec4f());
    let a = vertices[n.corners.x].x;
    let b = vertices[n.corners.y].x;
    let c = vertices[n.corners.z].x;
    let d = vertices[n.corners.w].x;
    let middle = between(n.weights * firsts, Four(a.xyz, b.xyz, c.xyz, d.xyz)) - n.normal * (0.5 * n.distance);
    let clearance = clearance(n.distance, n.thickness);
    let heights = sides * vec4f(
        dot(n.normal, a.xyz - middle),
        dot(n.normal, b.xyz - middle),
        dot(n.normal, c.xyz - middle),
        dot(n.normal, d.xyz - middle),
    );
    let towards = -sides * vec4f(
        dot(n.normal, way_of(n.corners.x)),
        dot(n.normal, way_of(n.corners.y)),
        dot(n.normal, way_of(n.corners.z)),
        dot(n.normal, way_of(n.corners.w)),
    );
    // Kinematic and carried corners are not truncated. As far as one of them would cross the plane, the plane is shifted;
    // if both sides push, by the difference.
    let w = vec4f(a.w, b.w, c.w, d.w);
    let is_kinematic = w <= vec4f();
    // Which pairs are clear is decided in the first round only, because kernels may round differently. Holding others again
    // changes nothing.
    let is_free = !any(is_kinematic);
    let is_left = ROUND == 0u && is_free && is_clear(heights, towards, firsts, clearance);
    if is_left || (ROUND > 0u && !is_free) || (ROUND == 1u && !is_shortened(n.corners)) {
        return;
    }
    let out = select(vec4f(), max(clearance - (heights - towards), vec4f()), is_kinematic);
    let shift_from_first = most_of(out * firsts);
    let shift_from_second = most_of(out * (1.0 - firsts));
    let shifted = heights - sides * (shift_from_second - shift_from_first);
    // The plane, and the vertex that shifted it, may have moved past a vertex that stays in place, or two kinematic sides
    // into each other.
    if any(select(shifted, vec4f(), is_kinematic) < vec4f()) || shift_from_second + shift_from_first > 2.0 * clearance {
        let at = atomicAdd(&contact_state.status.passed, 1u);
        let is_edge = n.listed >= with_vertices;
        pairs[place_of_passed(at)].corners = vec4u(n.corners.x | select(0u, MARK, is_edge), n.corners.yzw);
    }
    truncate_vertex(n.corners.x, w.x, share_above(shifted.x, clearance, towards.x));
    truncate_vertex(n.corners.y, w.y, share_above(shifted.y, clearance, towards.y));
    truncate_vertex(n.corners.z, w.z, share_above(shifted.z, clearance, towards.z));
    truncate_vertex(n.corners.w, w.w, share_above(shifted.w, clearance, towards.w));
    if !AGAIN && contact_params.mesh_leaves > 0u && any(is_kinematic) {
        let beyond = towards - max(shifted - clearance, vec4f());
        let is_beyond = !is_kinematic & (towards > vec4f()) & (beyond > vec4f());
        let by = select(vec4f(), min(beyond, vec4f(contact_params.thickness)), is_beyond);
        slide_vertex(n.corners.x, -sides.x * n.normal, by.x);
        slide_vertex(n.corners.y, -sides.y * n.normal, by.y);
        slide_vertex(n.corners.z, -sides.z * n.normal, by.z);
        slide_vertex(n.corners.w, -sides.w * n.normal, by.w);
    }
}

// Whether a plane that moves along with a pair stays between its sides.
fn is_clear(heights: vec4f, towards: vec4f, firsts: vec4f, clearance: f32) -> bool {
    let ends = heights - towards;
    let of_firsts = least_of(select(vec4f(FAR), ends, firsts > vec4f()));
    let of_seconds = least_of(select(ends, vec4f(FAR), firsts > vec4f()));
    return least_of(heights) > 0.0 && of_firsts + of_seconds > 2.0 * clearance;
}

// Whether the first round has shortened a corner of a pair without kinematic ones.
fn is_shortened(corners: vec4u) -> bool {
    return share_of(corners.x) < 1.0 || share_of(corners.y) < 1.0 || share_of(corners.z) < 1.0 || share_of(corners.w) < 1.0;
}

fn share_of(v: u32) -> f32 {
    return bitcast<f32>(atomicLoad(&sums[SUMS * v + SHARE]));
}

fn least_of(v: vec4f) -> f32 {
    return min(min(v.x, v.y), min(v.z, v.w));
}

fn most_of(v: vec4f) -> f32 {
    return max(max(v.x, v.y), max(v.z, v.w));
}

// The second round leaves the shares alone that it reads, and notes what it cuts.
fn truncate_vertex(v: u32, w: f32, share: f32) {
    if !(share < 1.0 && w > 0.0) {
        return;
    }
    if ROUND == 1u {
        atomicMax(&sums[SUMS * v + CUT], bitcast<i32>(1.0 - share));
        if share_of(v) == 1.0 {
            atomicStore(&contact_state.status.cuts_more, 1u);
        }
        return;
    }
    atomicMin(&sums[SUMS * v + SHARE], bitcast<i32>(share));
    if atomicLoad(&contact_state.status.shortens) == 0u {
        atomicStore(&contact_state.status.shortens, 1u);
    }
}

// Adds how far [m] a vertex of a pair with a kinematic side gets beyond the plane in a direction. If it does, vertices slide.
fn slide_vertex(v: u32, direction: vec3f, by: f32) {
    if by > 0.0 {
        let share = by / contact_params.thickness;
        add_units(v, BEYOND, vec3i(round(direction * (share * UNIT_BEYOND))));
        atomicAdd(&sums[SUMS * v + SQUARES], i32(round(share * share * UNIT_BEYOND)));
        if atomicLoad(&contact_state.status.again) == 0u {
            atomicStore(&contact_state.status.again, 1u);
        }
    }
}

// Truncates for all near pairs, and stores the multipliers of those that act in the list.
@compute @workgroup_size(WORKGROUP)
fn truncate(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let acting = acting_pairs(lane);
    if lane == 0u {
        var skips = is_idle() || (AGAIN && atomicLoad(&contact_state.status.again) == 0u);
        // What slides is truncated again.
        skips |= ROUND > 0u && !AGAIN && atomicLoad(&contact_state.status.again) > 0u;
        skips |= ROUND > 0u && atomicLoad(&contact_state.status.shortens) == 0u;
        skips |= ROUND > 1u && atomicLoad(&contact_state.status.cuts_more) == 0u;
        total = select(acting + atomicLoad(&contact_state.status.near), 0u, skips);
        with_vertices = atomicLoad(&contact_state.status.with_vertices);
        atomicStore(&pressing, 0u);
    }
    let all = workgroupUniformLoad(&total);
    if ROUND == 0u && item(id, groups) == 0u {
        atomicStore(&contact_state.status.cuts_more, 0u);
    }
    var mine = 0u;
    var squeezed = 0u;
    for (var k = item(id, groups); k < all; k += stride(groups)) {
        let acts = k < acting;
        let n = near_at(place_of(select(1u, 2u, acts), select(k - acting, k, acts)));
        truncate_pair(n);
        if acts && !AGAIN && ROUND == 0u {
            pairs[place(n.listed)].lambda = n.lambda;
            mine += u32(n.lambda.w > 0.0);
            squeezed += u32(n.thickness - n.distance > SQUEEZED * n.thickness && any(inverse_masses(n.corners) == vec4f()));
        }
    }
    if squeezed > 0u {
        atomicAdd(&contact_state.status.squeezed, squeezed);
    }
    if mine > 0u {
        atomicAdd(&pressing, mine);
    }
    workgroupBarrier();
    if lane == 0u && atomicLoad(&pressing) > 0u {
        atomicAdd(&contact_state.status.pressing, atomicLoad(&pressing));
    }
}
