// The start of contact in a substep: resolves contact with colliders, computes the mean displacement, and decides
// whether detection is due.

// Whether this substep includes the kernels of detection.
override MAY_DETECT: bool = true;
// Whether it has any other kernels of contact. Otherwise, only colliders and the distance to the path matter.
override HAS_CONTACT: bool = true;

// If only every few substeps include detection, it is due already if a vertex has strayed by this share of how far it may.
const SOON: f32 = 0.45;

// The multipliers of a substep are at most so many times those of the last one: see `response.rs`.
const MOST_GROWTH: f32 = 16.0;

var<workgroup> samples: array<vec3f, SAMPLES>;

// Number of vertices from which the common deviation is estimated.
const SAMPLES: u32 = 32u;
// Number of substeps for which a vertex should stay close to its path; the second while anything crosses.
const LASTS: f32 = 16.0;
const LASTS_CROSSED: f32 = 12.0;
// Range of the number of substeps that detection looks ahead, and the factor by which it grows.
const MIN_AHEAD: f32 = 6.0;
const MAX_AHEAD: f32 = 64.0;
const FARTHER_AHEAD: f32 = 1.5;

// A vertex's part of the reduction: for a free cloth the mean by mass, otherwise the range of the pins' displacements besides
// their rotation.
fn part_of(u: vec3f, w: f32) -> Part {
    if is_free() {
        return Part(vec4f(u, 1.0) / w, vec4f());
    }
    if w == 0.0 {
        return Part(vec4f(u, 0.0), vec4f(u, 0.0));
    }
    return nothing();
}

// An estimate of the common deviation of a free cloth from the paths, from a few vertices. It is subtracted, because a
// common translation brings no two vertices closer to each other.
fn strayed_together(lane: u32) -> vec3f {
    let each = (params.used + SAMPLES - 1u) / SAMPLES;
    let count = (params.used + each - 1u) / each;
    if lane < SAMPLES {
        let i = min(lane, count - 1u) * each;
        let strayed = x[i].xyz - tracks[i].start.xyz - tracks[i].by.xyz * since();
        samples[lane] = select(vec3f(), strayed, lane < count);
    }
    for (var width = SAMPLES / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if lane < width {
            samples[lane] += samples[lane + width];
        }
    }
    workgroupBarrier();
    return samples[0] / f32(count);
}

// Moves a vertex out of the colliders, and tests whether it is close enough to its path.
fn begin_vertex(i: u32, together: vec3f) -> Part {
    let x_i = x[i];
    let free = p_out[i].xyz;
    var path = path_of(x_i.xyz, free);
    if x_i.w > 0.0 {
        for (var k = 0u; k < contact_params.bodies; k++) {
            path = contact_body(path, bodies[k], substep);
        }
    }
    let push = path.x - x_i.xyz;
    if !(is_bounded(x_i.xyz) && is_bounded(path.u) && is_bounded(push)) {
        atomicOr(&contact_state.status.stopped, NOT_FINITE);
    }
    x_out[i] = vec4f(path.x + path.u, x_i.w);
    p_out[i] = vec4f(path.u, params.h);
    let pushed = length(push);
    if pushed > contact_params.thickness {
        atomicStore(&contact_state.status.jumped, 1u);
    }
    if HAS_CONTACT {
        vertices[i].x = x_i;
        vertices[i].u = vec4f(path.u, x_i.w);
        vertices[i].push = vec4f(push, 0.0);
        vertices[i].way = vec4f(free, 0.0);
        if pushed > 0.0 {
            atomicMax(&contact_state.status.most_push, bitcast<u32>(pushed));
        }
    }
    let track = tracks[i];
    let strayed = (x_i.xyz - track.start.xyz) + (path.u - track.by.xyz * (since() + 1.0)) - together;
    // Written so that NaN counts as too far.
    if !(square(strayed * track.by.w) < select(1.0, SOON * SOON, MAY_DETECT && contact_params.spacing > 1u)) {
        if MAY_DETECT {
            atomicOr(&contact_state.status.strayed, 1u);
        } else {
            atomicOr(&contact_state.status.stopped, EARLY);
        }
    }
    // Vertices without edges are not part of the cloth.
    if i >= params.used {
        return nothing();
    }
    return part_of(path.u - by_turning(x_i.xyz), x_i.w);
}

// Moves a vertex of a mesh collider through the substep, and tests whether it is close enough to its path.
fn begin_mesh_vertex(i: u32) {
    let motion = tracks[contact_params.all_vertices + i - contact_params.mesh_first];
    let x_i = motion.start.xyz + motion.by.xyz * substep.start;
    let u_i = motion.by.xyz * params.fraction;
    vertices[i].x = vec4f(x_i, 0.0);
    vertices[i].u = vec4f(u_i, 0.0);
    vertices[i].push = vec4f(vec3f(), motion.start.w);
    // Its motion is uniform, so that one test covers the substeps up to the next one that may detect anyway. One that stands
    // still is tested at the start of the step only, and must not have a path that goes on.
    if MAY_DETECT {
        let track = tracks[i];
        let ahead = f32(contact_params.spacing);
        let strayed = (x_i - track.start.xyz) + (u_i * ahead - track.by.xyz * (since() + ahead));
        let stops = contact_params.meshes_rest != 0u && any(track.by.xyz != vec3f());
        if stops || !(square(strayed * track.by.w) < 1.0) {
            atomicOr(&contact_state.status.strayed, 1u);
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn begin_contact(me: Invocation, group: Workgroup) {
    let i = item(me.id, group.all);
    var together = vec3f();
    if floats() {
        together = strayed_together(me.lane);
    }
    var part = nothing();
    if i < contact_params.vertices && !has_stopped() {
        part = begin_vertex(i, together);
    } else if HAS_CONTACT && i >= contact_params.mesh_first && i < contact_params.all_vertices && !has_stopped() {
        begin_mesh_vertex(i);
    }
    if !HAS_CONTACT {
        return;
    }
    store_part(part, 0u, contact_params.groups, me.lane, group);
}

// One workgroup computes the mean displacement and decides whether detection is due.
@compute @workgroup_size(WORKGROUP)
fn decide(@builtin(local_invocation_index) lane: u32) {
    let mean = mean_of_parts(lane);
    if lane == 0u && has_stopped() {
        // A list without room was counted in full in the substep that stopped the step.
        contact_state.status.detects = 0u;
    } else if lane == 0u {
        contact_state.status.mean = mean;
        begin_substep();
    }
}

fn begin_substep() {
    contact_state.status.pushed = bitcast<f32>(atomicExchange(&contact_state.status.most_push, 0u));
    contact_state.status.acted = atomicExchange(&contact_state.status.acting, 0u);
    let was_near = atomicExchange(&contact_state.status.near, 0u) + contact_state.status.acted;
    atomicStore(&contact_state.status.pressing, 0u);
    atomicStore(&contact_state.status.squeezed, 0u);
    atomicStore(&contact_state.status.again, 0u);
    atomicStore(&contact_state.status.shortens, 0u);
    atomicStore(&contact_state.status.passed, 0u);
    let strayed = atomicExchange(&contact_state.status.strayed, 0u) != 0u;
    contact_state.status.scale = 0.0;
    if contact_state.status.h > 0.0 {
        let growth = params.h / contact_state.status.h;
        contact_state.status.scale = min(growth * growth, MOST_GROWTH);
    }
    contact_state.status.h = params.h;
    let over = since();
    let ends = over + f32(contact_params.spacing) > contact_state.status.ahead;
    contact_state.status.detects = u32(MAY_DETECT && (over < 0.0 || ends || strayed || contact_params.covers_stops != 0u));
    if contact_state.status.detects != 0u {
        let listed = atomicExchange(&contact_state.status.listed, 0u);
        contact_state.status.vertices_before = atomicExchange(&contact_state.status.with_vertices, 0u);
        contact_state.status.edges_before = atomicExchange(&contact_state.status.with_edges, 0u);
        contact_state.status.half = 1u - contact_state.status.half;
        atomicStore(&contact_state.status.leaf_pairs, 0u);
        atomicStore(&contact_state.status.candidates, 0u);
        atomicStore(&contact_state.status.edge_candidates, 0u);
        let is_short = 4u * listed < contact_params.all_vertices;
        let is_long = listed > 4u * (contact_params.all_vertices + was_near);
        contact_state.status.longer = -1.0;
        if over >= 0.0 && !is_short {
            let crosses = contact_params.ignored + contact_params.ignored_edges > 0u;
            contact_state.status.longer = pow(max(select(LASTS, LASTS_CROSSED, crosses) / (over + 1.0), 1.0), 1.5);
        }
        contact_state.status.over = over + 1.0;
        var ahead = MIN_AHEAD;
        if ends {
            ahead = select(FARTHER_AHEAD * contact_state.status.ahead, contact_state.status.ahead / FARTHER_AHEAD, is_long);
        } else if over >= 0.0 {
            ahead = FARTHER_AHEAD * over;
        }
        // The list must last until detection may be due again.
        contact_state.status.ahead = clamp(floor(ahead + 0.5), max(MIN_AHEAD, f32(contact_params.spacing)), MAX_AHEAD);
        if contact_params.covers_stops != 0u {
            contact_state.status.ahead = 1.0;
        }
        contact_state.status.since = 0.0;
        contact_state.status.detections += 1u;
    } else {
        contact_state.status.since = over;
    }
    contact_state.status.since += 1.0;
    contact_state.status.counted = index_of_substep() + 1u;
}
