// Bending of vertices that one workgroup holds together, so that its passes are separated by barriers and not by
// dispatches. The layout of the rings in the table is in src/gpu/slices.rs. The including shader defines where a
// vertex's row (`row_of`), the passes (`bend_pass_at`, `is_filtered`) and the slices of the rings (`ring_slices`) are,
// the position and the last displacement of a vertex (`bent_x`, `bent_p`), and how the intermediate vectors are stored
// (`bend_vector`, `set_bend_vector`), with room for `bend_room` vertices.

// The number of vertices whose entries are interleaved, so that neighboring lanes read neighboring words.
const SLICE: u32 = 32u;

// Positions of a vertex's vectors: moment and couple always, the others only with several passes.
fn moment_of(k: u32) -> u32 {
    return k;
}

fn couple_at(k: u32) -> u32 {
    return bend_room() + k;
}

fn curvature_of(k: u32) -> u32 {
    return 2u * bend_room() + k;
}

fn change_of(k: u32) -> u32 {
    return 3u * bend_room() + k;
}

fn trial_of(k: u32) -> u32 {
    return 4u * bend_room() + k;
}

fn resisted_of(k: u32) -> u32 {
    return 5u * bend_room() + k;
}

// The words of a vertex's entries: one entry starts every `3 SLICE` words.
fn ring_of(k: u32) -> Span {
    let slice = ring_slices() + k / SLICE;
    return Span(table[slice] + k % SLICE, table[slice + 1u]);
}

// The neighbor of an entry is a position among the vertices held.
fn entry_at(at: u32) -> BendEntry {
    return BendEntry(table[at], bitcast<f32>(table[at + SLICE]), bitcast<f32>(table[at + 2u * SLICE]));
}

fn first_moment(k: u32, rate: f32) {
    let x_k = bent_x(k);
    let span = ring_of(k);
    var ring = Ring();
    if params.damped == 0u {
        for (var at = span.start; at < span.end; at += 3u * SLICE) {
            let entry = entry_at(at);
            ring.y += (bent_x(entry.other) - x_k) * entry.forward;
        }
    } else {
        let p_k = bent_p(k);
        for (var at = span.start; at < span.end; at += 3u * SLICE) {
            let entry = entry_at(at);
            if entry.forward != 0.0 {
                add_neighbor(&ring, bent_x(entry.other) - x_k, (bent_p(entry.other) - p_k) * rate, entry.forward);
            }
        }
    }
    let row = row_of(k);
    let damping = row.stiffness * row.tau;
    if !is_filtered() {
        let bend = bend_moment(ring, row.stiffness, damping);
        set_bend_vector(moment_of(k), bend.moment);
        set_bend_vector(couple_at(k), bend.couple);
        return;
    }
    let resisted = bend_moment(ring, 0.0, damping);
    let passed = next_moment(vec3f(), vec3f(), ring.y, row.stiffness, bend_pass_at(0u));
    set_bend_vector(moment_of(k), passed.moment);
    set_bend_vector(couple_at(k), resisted.couple);
    set_bend_vector(curvature_of(k), ring.y);
    set_bend_vector(change_of(k), passed.change);
    set_bend_vector(resisted_of(k), resisted.moment);
}

fn trial_displacements(k: u32, w: f32, bend_pass: BendPass) {
    let span = ring_of(k);
    var force = bend_vector(moment_of(k)) * row_of(k).diagonal;
    for (var at = span.start; at < span.end; at += 3u * SLICE) {
        let entry = entry_at(at);
        force += bend_vector(moment_of(entry.other)) * entry.backward;
    }
    set_bend_vector(trial_of(k), force * (w * bend_pass.trial));
}

fn filter_moments(k: u32, bend_pass: BendPass) {
    let span = ring_of(k);
    let own = bend_vector(trial_of(k));
    var bent = bend_vector(curvature_of(k));
    for (var at = span.start; at < span.end; at += 3u * SLICE) {
        let entry = entry_at(at);
        bent += (bend_vector(trial_of(entry.other)) - own) * entry.forward;
    }
    let passed = next_moment(bend_vector(moment_of(k)), bend_vector(change_of(k)), bent, row_of(k).stiffness, bend_pass);
    if bend_pass.last == 0u {
        set_bend_vector(moment_of(k), passed.moment);
        set_bend_vector(change_of(k), passed.change);
    } else {
        set_bend_vector(moment_of(k), passed.moment + bend_vector(resisted_of(k)));
    }
}

fn bend_force(k: u32) -> vec3f {
    let span = ring_of(k);
    var force = -bend_vector(moment_of(k)) * row_of(k).diagonal;
    if params.damped == 0u {
        for (var at = span.start; at < span.end; at += 3u * SLICE) {
            let entry = entry_at(at);
            force -= bend_vector(moment_of(entry.other)) * entry.backward;
        }
        return force;
    }
    let x_k = bent_x(k);
    let own = bend_vector(couple_at(k));
    for (var at = span.start; at < span.end; at += 3u * SLICE) {
        let entry = entry_at(at);
        force -= bend_vector(moment_of(entry.other)) * entry.backward;
        let couple = couple_of(own, bend_vector(couple_at(entry.other)), entry);
        force -= cross(couple, bent_x(entry.other) - x_k);
    }
    return force;
}
