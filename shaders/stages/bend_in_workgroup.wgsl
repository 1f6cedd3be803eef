// The stages of bending, for vertices whose rings are in slices of a table (src/gpu/slices.rs). Where one workgroup holds
// them together, the stages are separated by barriers and not by dispatches. The including shader defines where a
// vertex's row (`row_of`), the passes (`bend_pass_at`, `is_filtered`) and the slices of the rings (`ring_slices`) are.

// The number of vertices whose entries are interleaved, so that neighboring lanes read neighboring words.
const SLICE: u32 = 32u;
// Entries that are fetched together, ahead of their use: 8, or 0 in a workgroup so large that its invocations have too few
// registers for that.
override AHEAD: u32 = 8u;

fn entry_stride() -> u32 {
    return SLICE;
}

fn entries_of(k: u32) -> Entries {
    let slice = ring_slices() + k / SLICE;
    return Entries(k, table[slice] + k % SLICE, table[slice + 1u]);
}

// What is fetched for a vertex before its moment is computed.
struct Fetched {
    entries: Entries,
    four: FourEntries,
    next: FourEntries,
    row: BendRow,
}

fn fetched(k: u32) -> Fetched {
    let entries = entries_of(k);
    if AHEAD == 0u {
        return Fetched(entries, FourEntries(), FourEntries(), BendRow());
    }
    return Fetched(entries, fetch_four_entries(entries, 0u), fetch_four_entries(entries, 4u), row_of(k));
}

// The row of a vertex, fetched now if it was not before.
fn row_in(k: u32, ahead: Fetched) -> BendRow {
    if AHEAD == 0u {
        return row_of(k);
    }
    return ahead.row;
}

fn first_moment(k: u32, rate: f32, ahead: Fetched) {
    let entries = ahead.entries;
    var ring = Ring();
    if AHEAD > 0u {
        add_four_entries(&ring, k, rate, ahead.four);
        add_four_entries(&ring, k, rate, ahead.next);
    }
    for (var at = entries.start + 3u * AHEAD * SLICE; at < entries.end; at += 3u * SLICE) {
        add_entry(&ring, k, rate, entry_at(at));
    }
    let row = row_in(k, ahead);
    let damping = row.stiffness * row.tau;
    if !is_filtered() {
        let bend = bend_moment(ring, row.stiffness, damping);
        set_bend_vector(place_of(MOMENT, k), bend.moment);
        set_bend_vector(place_of(COUPLE, k), bend.couple);
        return;
    }
    let resisted = bend_moment(ring, 0.0, damping);
    let passed = next_moment(vec3f(), vec3f(), ring.y, row.stiffness, bend_pass_at(0u));
    set_bend_vector(place_of(MOMENT, k), passed.moment);
    set_bend_vector(place_of(COUPLE, k), resisted.couple);
    set_bend_vector(place_of(CURVATURE, k), ring.y);
    set_bend_vector(place_of(CHANGE, k), passed.change);
    set_bend_vector(place_of(RESISTED, k), resisted.moment);
}

// The force of an entry's moment alone, and a sum with four of them.
fn push_of(entry: BendEntry) -> vec3f {
    return bend_vector(place_of(MOMENT, entry.other)) * entry.backward;
}

fn push_of_four(force: vec3f, four: FourEntries) -> vec3f {
    return force + push_of(four.a) + push_of(four.b) + push_of(four.c) + push_of(four.d);
}

fn trial_displacements(k: u32, w: f32, bend_pass: BendPass) {
    let entries = entries_of(k);
    var force = bend_vector(place_of(MOMENT, k)) * row_of(k).diagonal;
    if AHEAD > 0u {
        let four = fetch_four_entries(entries, 0u);
        let next = fetch_four_entries(entries, 4u);
        force = push_of_four(push_of_four(force, four), next);
    }
    for (var at = entries.start + 3u * AHEAD * SLICE; at < entries.end; at += 3u * SLICE) {
        force += push_of(entry_at(at));
    }
    set_bend_vector(place_of(TRIAL, k), force * (w * bend_pass.trial));
}

// The part of an entry in the change of the curvature normal by tentative displacements, that of the vertex being `own`.
fn bent_by(own: vec3f, entry: BendEntry) -> vec3f {
    return (bend_vector(place_of(TRIAL, entry.other)) - own) * entry.forward;
}

fn bent_by_four(bent: vec3f, own: vec3f, four: FourEntries) -> vec3f {
    return bent + bent_by(own, four.a) + bent_by(own, four.b) + bent_by(own, four.c) + bent_by(own, four.d);
}

fn filter_moments(k: u32, bend_pass: BendPass) {
    let entries = entries_of(k);
    let own = bend_vector(place_of(TRIAL, k));
    var bent = bend_vector(place_of(CURVATURE, k));
    if AHEAD > 0u {
        let four = fetch_four_entries(entries, 0u);
        let next = fetch_four_entries(entries, 4u);
        bent = bent_by_four(bent_by_four(bent, own, four), own, next);
    }
    for (var at = entries.start + 3u * AHEAD * SLICE; at < entries.end; at += 3u * SLICE) {
        bent += bent_by(own, entry_at(at));
    }
    let moment = bend_vector(place_of(MOMENT, k));
    let passed = next_moment(moment, bend_vector(place_of(CHANGE, k)), bent, row_of(k).stiffness, bend_pass);
    if bend_pass.last == 0u {
        set_bend_vector(place_of(MOMENT, k), passed.moment);
        set_bend_vector(place_of(CHANGE, k), passed.change);
    } else {
        set_bend_vector(place_of(MOMENT, k), passed.moment + bend_vector(place_of(RESISTED, k)));
    }
}

fn bend_force(k: u32, ahead: Fetched) -> vec3f {
    let entries = ahead.entries;
    let own = bend_vector(place_of(COUPLE, k));
    var force = -bend_vector(place_of(MOMENT, k)) * row_in(k, ahead).diagonal;
    if AHEAD > 0u {
        force = force_of_four(force_of_four(force, k, own, ahead.four), k, own, ahead.next);
    }
    for (var at = entries.start + 3u * AHEAD * SLICE; at < entries.end; at += 3u * SLICE) {
        force += force_of(k, own, entry_at(at));
    }
    return force;
}
