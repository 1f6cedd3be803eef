// Truncates displacements: src/contact/contacts/truncation.rs has the theory.

// Whether displacements are truncated once more in a substep, because vertices slide or were carried.
override AGAIN: bool = false;
// Pairs are held in three rounds: those that are not clear, those that were until a corner was shortened, and then all if that
// has shortened others.
override ROUND: u32 = 0u;

// The number of pairs with a normal impulse that a workgroup counts.
var<workgroup> pressing: atomic<u32>;

// How far a vertex moves relative to the common motion, after the response. Vertices of mesh colliders are not corrected.
fn way_of(v: u32) -> vec3f {
    if v >= contact_params.vertices {
        return without_turning(way_with(v, vec3f()));
    }
    return vertices[v].way.xyz;
}

// Computes the shares of its vertices' displacements with which a pair stays on both sides of a plane between them.
fn truncate_pair(n: Near) {
    let is_edge = n.listed >= with_vertices;
    let v = n.corners;
    // Not those of displacements, because those of vertices that are carried are negative.
    let w = vec4f(vertices[v.x].x.w, vertices[v.y].x.w, vertices[v.z].x.w, vertices[v.w].x.w);
    let is_kinematic = w <= vec4f();
    // Which pairs are clear is decided in the first round only, because kernels may round differently. Holding others again
    // changes nothing.
    let is_free = !any(is_kinematic);
    if (ROUND > 0u && !is_free) || (ROUND == 1u && !is_shortened(v)) {
        return;
    }
    let at = positions(v);
    let ways = Four(way_of(v.x), way_of(v.y), way_of(v.z), way_of(v.w));
    let firsts = firsts_of(is_edge);
    let middle = between(n.weights * firsts, at) - n.normal * (0.5 * n.distance);
    let heights = (2.0 * firsts - 1.0) * along_normal(n.normal, Four(at.a - middle, at.b - middle, at.c - middle, at.d - middle));
    let plane = Plane(n.normal, heights, clearance(n.distance, n.thickness));
    var held = hold(plane, ways, is_kinematic, contact_params.thickness, is_edge);
    if ROUND == 0u && is_free && stays_between(plane, held.towards, is_edge) {
        return;
    }
    if least_of(held.shares) == 1.0 && held.passed_by == 0.0 {
        return;
    }
    held = least_shortening(plane, held, at, ways, is_kinematic, contact_params.thickness, is_edge);
    // The plane, and the vertex that shifted it, may have moved past a vertex that stays in place, or two kinematic sides
    // into each other.
    if held.passed_by > 0.0 {
        let at = atomicAdd(&contact_state.status.passed, 1u);
        pairs[place_of_passed(at)].corners = vec4u(v.x | select(0u, MARK, is_edge), v.yzw);
    }
    truncate_vertex(v.x, w.x, held.shares.x);
    truncate_vertex(v.y, w.y, held.shares.y);
    truncate_vertex(v.z, w.z, held.shares.z);
    truncate_vertex(v.w, w.w, held.shares.w);
    if !AGAIN && !is_free {
        let beyond = held.towards - max(held.plane.heights - held.plane.clearance, vec4f());
        let is_beyond = !is_kinematic & (held.towards > vec4f()) & (beyond > vec4f());
        let by = select(vec4f(), min(beyond, vec4f(contact_params.thickness)), is_beyond);
        let directions = 1.0 - 2.0 * firsts;
        slide_vertex(v.x, directions.x * held.plane.normal, by.x);
        slide_vertex(v.y, directions.y * held.plane.normal, by.y);
        slide_vertex(v.z, directions.z * held.plane.normal, by.z);
        slide_vertex(v.w, directions.w * held.plane.normal, by.w);
    }
}

// Whether the first round has shortened a corner of a pair without kinematic ones.
fn is_shortened(corners: vec4u) -> bool {
    return share_of(corners.x) < 1.0 || share_of(corners.y) < 1.0 || share_of(corners.z) < 1.0 || share_of(corners.w) < 1.0;
}

fn share_of(v: u32) -> f32 {
    return bitcast<f32>(atomicLoad(&sums[SUMS * v + SHARE]));
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
fn truncate(me: Invocation, group: Workgroup) {
    let acting = acting_pairs(me.lane);
    if me.lane == 0u {
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
    if ROUND == 0u && item(me.id, group.all) == 0u {
        atomicStore(&contact_state.status.cuts_more, 0u);
    }
    var mine = 0u;
    var squeezed = 0u;
    for (var k = item(me.id, group.all); k < all; k += stride(group.all)) {
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
    if me.lane == 0u && atomicLoad(&pressing) > 0u {
        atomicAdd(&contact_state.status.pressing, atomicLoad(&pressing));
    }
}
