// The entries of a vertex's one-ring in the table of a workgroup that bends several vertices. The including shader defines
// the distance of an entry's words (`entry_stride`), the position and the last displacement of a vertex (`bent_x`,
// `bent_p`), and how the intermediate vectors are stored (`bend_vector`, `set_bend_vector`), with room for `bend_room`
// vertices.

// The vectors of a vertex: moment and couple always, the others only with several passes.
const MOMENT: u32 = 0u;
const COUPLE: u32 = 1u;
const CURVATURE: u32 = 2u;
const CHANGE: u32 = 3u;
const TRIAL: u32 = 4u;
const RESISTED: u32 = 5u;

// The position of one of the vectors of vertex `k`.
fn place_of(vector: u32, k: u32) -> u32 {
    return vector * bend_room() + k;
}

// The entries of vertex `k`: of each the neighbor, as a position among the vertices held, then the forward coefficient, then
// the backward one. The first entry starts at word `start`; there are none from word `end` on.
struct Entries {
    k: u32,
    start: u32,
    end: u32,
}

// Entries that are fetched together: memory takes longer to answer than an entry to compute.
struct FourEntries {
    a: BendEntry,
    b: BendEntry,
    c: BendEntry,
    d: BendEntry,
}

fn entry_at(at: u32) -> BendEntry {
    let stride = entry_stride();
    return BendEntry(table[at], bitcast<f32>(table[at + stride]), bitcast<f32>(table[at + 2u * stride]));
}

// Those past the last one have no effect.
fn fetch_entry(entries: Entries, index: u32) -> BendEntry {
    let at = entries.start + 3u * index * entry_stride();
    if at >= entries.end {
        return BendEntry(entries.k, 0.0, 0.0);
    }
    return entry_at(at);
}

fn fetch_four_entries(entries: Entries, index: u32) -> FourEntries {
    return FourEntries(
        fetch_entry(entries, index),
        fetch_entry(entries, index + 1u),
        fetch_entry(entries, index + 2u),
        fetch_entry(entries, index + 3u),
    );
}

fn add_entry(ring: ptr<function, Ring>, k: u32, rate: f32, entry: BendEntry) {
    let d = bent_x(entry.other) - bent_x(k);
    if params.damped == 0u {
        (*ring).y += d * entry.forward;
    } else if entry.forward != 0.0 {
        add_neighbor(ring, d, (bent_p(entry.other) - bent_p(k)) * rate, entry.forward);
    }
}

fn add_four_entries(ring: ptr<function, Ring>, k: u32, rate: f32, four: FourEntries) {
    add_entry(ring, k, rate, four.a);
    add_entry(ring, k, rate, four.b);
    add_entry(ring, k, rate, four.c);
    add_entry(ring, k, rate, four.d);
}

// The force of an entry on vertex `k`, whose couple is `own`.
fn force_of(k: u32, own: vec3f, entry: BendEntry) -> vec3f {
    let pull = bend_vector(place_of(MOMENT, entry.other)) * -entry.backward;
    if params.damped == 0u {
        return pull;
    }
    let couple = couple_of(own, bend_vector(place_of(COUPLE, entry.other)), entry);
    return pull - cross(couple, bent_x(entry.other) - bent_x(k));
}

// The forces of four entries are added one after the other: sums of them, added at once, would change the momentum by more.
fn force_of_four(force: vec3f, k: u32, own: vec3f, four: FourEntries) -> vec3f {
    return force + force_of(k, own, four.a) + force_of(k, own, four.b) + force_of(k, own, four.c) + force_of(k, own, four.d);
}
