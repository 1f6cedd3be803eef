// The end of contact in a substep: applies the shares of truncation and updates the positions, then returns the lost
// momentum to the cloth as a whole. Where vertices slide, that is the end of truncating once more.

// Whether displacements were truncated once more in this substep.
override AGAIN: bool = false;

@compute @workgroup_size(WORKGROUP)
fn finish(me: Invocation, group: Workgroup) {
    let i = item(me.id, group.all);
    var mine = vec3f();
    let is_again = atomicLoad(&contact_state.status.again) > 0u;
    let near_pairs = atomicLoad(&contact_state.status.near) + atomicLoad(&contact_state.status.acting);
    let is_touched = (!AGAIN || is_again) && !has_stopped() && near_pairs > 0u && i < contact_params.vertices;
    let slides = !AGAIN && is_again;
    if is_touched && slides {
        slide(i);
    } else if is_touched && vertices[i].x.w != 0.0 {
        // The inverse mass of a vertex that is carried is negative.
        let w = abs(vertices[i].x.w);
        var u = vertices[i].u.xyz;
        var push = vertices[i].push.xyz;
        let cut = bitcast<f32>(atomicLoad(&sums[SUMS * i + CUT]));
        let share = min(bitcast<f32>(atomicLoad(&sums[SUMS * i + SHARE])), 1.0 - cut);
        if share < 1.0 {
            let base = contact_state.status.mean + by_turning(vertices[i].x.xyz);
            let after = base + (u - base) * share;
            mine = (u - after) / w;
            u = after;
            push *= share;
            vertices[i].u = vec4f(u, w);
            vertices[i].push = vec4f(push, 0.0);
            vertices[i].way = vec4f(vertices[i].way.xyz * share, vertices[i].way.w);
        }
        if drifts(i, u) {
            let at = atomicAdd(&contact_state.status.drifted, 1u);
            if at < DRIFTED {
                contact_state.drifted[at] = i;
            }
        }
        x_out[i] = vec4f(vertices[i].x.xyz + push + u, w);
        p_out[i] = vec4f(u, params.h);
    }
    if is_touched && !slides {
        clear_sums(i);
    }
    if slides && i == 0u {
        atomicStore(&contact_state.status.passed, 0u);
    }
    // Only free cloth gets the momentum back, and only then parts are sums. What is truncated once more has lost both times.
    if is_free() {
        let at = number_of(group);
        if AGAIN && me.lane == 0u && at < contact_params.groups {
            mine += contact_state.parts[at].low.xyz;
        }
        store_part(Part(vec4f(mine, 0.0), vec4f()), 0u, contact_params.groups, me.lane, group);
    }
}

// Whether a vertex gets farther from its path than it may, so that pairs that are not listed may cross. Paths of free cloth are
// relative to what it strays together, so that there it counts how far it moves elsewhere than it was about to.
fn drifts(i: u32, u: vec3f) -> bool {
    let most = allowance_of(i);
    if floats() {
        return length(u - p_out[i].xyz) > most;
    }
    let track = tracks[i];
    let strayed = (vertices[i].x.xyz - track.start.xyz) + (u - track.by.xyz * contact_state.status.since);
    return length(strayed) > track.start.w + most;
}

// Removes from the displacement of a vertex what leads it beyond planes, so that it can be truncated once more.
fn slide(i: u32) {
    let thickness = contact_params.thickness;
    let squares = f32(atomicLoad(&sums[SUMS * i + SQUARES])) * (thickness * thickness / UNIT_BEYOND);
    if squares > 0.0 {
        vertices[i].u -= vec4f(excess(summed(i, BEYOND, UNIT_BEYOND), squares), 0.0);
    }
    clear_sums(i);
    begin_truncation(i, vertices[i].way.w);
}

// Clears the sums of a vertex for the next substep.
fn clear_sums(i: u32) {
    for (var k = 0u; k < SHARE; k++) {
        atomicStore(&sums[SUMS * i + k], 0);
    }
    atomicStore(&sums[SUMS * i + SHARE], bitcast<i32>(1.0));
}

// Used if there are no kinematic vertices that may meet the cloth. Each workgroup computes the sum by itself, in the same order.
@compute @workgroup_size(WORKGROUP)
fn give_back(me: Invocation, group: Workgroup) {
    var mine = Part();
    for (var k = me.lane; k < contact_params.groups; k += WORKGROUP) {
        mine.low += contact_state.parts[k].low;
    }
    gather(mine, me.lane);
    workgroupBarrier();
    let back = low[0].xyz * contact_params.per_mass;
    let i = item(me.id, group.all);
    if i < contact_params.vertices && vertices[i].x.w != 0.0 && !has_stopped() && any(back != vec3f()) {
        let u = vertices[i].u.xyz + back;
        x_out[i] = vec4f(vertices[i].x.xyz + vertices[i].push.xyz + u, vertices[i].x.w);
        p_out[i] = vec4f(u, params.h);
    }
}
