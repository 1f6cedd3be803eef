// A substep of one tile with bending in a single pass, and without coarse levels. Around the vertices that are swept, the tile
// holds those whose moments act on them, and one more ring on which these moments depend. Each vertex has an invocation of its
// own, which fetches its entries before anything else, because memory takes longer to answer than all of bending to compute.

// Most vertices of a tile that are swept, and that have moments.
override FORCED: u32 = 64u;
override BENT: u32 = 64u;
// Most entries of a vertex.
override RING: u32 = 8u;
// Numbers of the moments: six for each vertex that has one.
override MOMENTS: u32 = 384u;
// The words of the table where the rows of all vertices begin, and the entries of each tile: for each entry of a vertex
// the other vertices, then the forward coefficients, then the backward ones.
override ROWS: u32 = 0u;
override RINGS: u32 = 0u;

// A moment and a couple for each vertex.
var<workgroup> moments: array<f32, MOMENTS>;

// Entries that are fetched together.
struct FourEntries {
    a: BendEntry,
    b: BendEntry,
    c: BendEntry,
    d: BendEntry,
}

// Entry number `index` of vertex `k` of the tile. Those past the last one have no effect.
fn fetch_entry(tile: u32, k: u32, index: u32) -> BendEntry {
    if index >= RING {
        return BendEntry(k, 0.0, 0.0);
    }
    let at = RINGS + 3u * BENT * (tile * RING + index) + k;
    return BendEntry(table[at], bitcast<f32>(table[at + BENT]), bitcast<f32>(table[at + 2u * BENT]));
}

fn fetch_four_entries(tile: u32, k: u32, index: u32) -> FourEntries {
    return FourEntries(
        fetch_entry(tile, k, index),
        fetch_entry(tile, k, index + 1u),
        fetch_entry(tile, k, index + 2u),
        fetch_entry(tile, k, index + 3u),
    );
}

fn row_of(v: u32) -> BendRow {
    let row = vector_in_table(ROWS + 3u * v);
    return BendRow(row.x, row.y, row.z);
}

fn vector_of(at: u32) -> vec3f {
    return vec3f(moments[3u * at], moments[3u * at + 1u], moments[3u * at + 2u]);
}

fn set_vector(at: u32, value: vec3f) {
    moments[3u * at] = value.x;
    moments[3u * at + 1u] = value.y;
    moments[3u * at + 2u] = value.z;
}

fn add_entry(ring: ptr<function, Ring>, k: u32, entry: BendEntry) {
    let d = tile_x[entry.other].xyz - tile_x[k].xyz;
    if params.damped == 0u {
        (*ring).y += d * entry.forward;
    } else if entry.forward != 0.0 {
        add_neighbor(ring, d, (tile_u[entry.other].xyz - tile_u[k].xyz) * substep.rate, entry.forward);
    }
}

fn add_four_entries(ring: ptr<function, Ring>, k: u32, four: FourEntries) {
    add_entry(ring, k, four.a);
    add_entry(ring, k, four.b);
    add_entry(ring, k, four.c);
    add_entry(ring, k, four.d);
}

// The force of an entry on vertex `k`, whose couple is `own`.
fn force_of(k: u32, own: vec3f, entry: BendEntry) -> vec3f {
    let pull = vector_of(entry.other) * -entry.backward;
    if params.damped == 0u {
        return pull;
    }
    let couple = couple_of(own, vector_of(BENT + entry.other), entry);
    return pull - cross(couple, tile_x[entry.other].xyz - tile_x[k].xyz);
}

fn force_of_four(k: u32, own: vec3f, four: FourEntries) -> vec3f {
    return force_of(k, own, four.a) + force_of(k, own, four.b) + force_of(k, own, four.c) + force_of(k, own, four.d);
}

@compute @workgroup_size(LANES)
fn substep_of_bent_tile(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = group.x + group.y * groups.x;
    if tile >= TILES {
        return;
    }
    let bent = min(lane, BENT - 1u);
    let four = fetch_four_entries(tile, bent, 0u);
    let next = fetch_four_entries(tile, bent, 4u);
    let edges = edges_of(tile);
    let first = fetch_four(edges, 0u, lane);
    let own = own_vertices(tile);
    let k = min(lane, ROOM - 1u);
    let v = vertex_at(tile, k);
    let x_v = x[v];
    let p_v = motion[v].xyz;
    let row = row_of(v);
    if lane < ROOM {
        tile_x[k] = x_v;
        tile_u[k] = vec4f(p_v, 0.0);
    }
    workgroupBarrier();
    var moment = Moment();
    if lane < BENT {
        var ring = Ring();
        add_four_entries(&ring, k, four);
        add_four_entries(&ring, k, next);
        for (var index = 8u; index < RING; index++) {
            add_entry(&ring, k, fetch_entry(tile, k, index));
        }
        moment = bend_moment(ring, row.stiffness, row.stiffness * row.tau);
        set_vector(k, moment.moment);
        set_vector(BENT + k, moment.couple);
    }
    workgroupBarrier();
    if lane < FORCED {
        var u_v = free_displacement(v, x_v, p_v);
        if x_v.w != 0.0 {
            var force = moment.moment * -row.diagonal;
            force += force_of_four(k, moment.couple, four);
            force += force_of_four(k, moment.couple, next);
            for (var index = 8u; index < RING; index++) {
                force += force_of(k, moment.couple, fetch_entry(tile, k, index));
            }
            u_v += force * (x_v.w * substep.gain);
        }
        tile_u[k] = vec4f(u_v, 0.0);
    }
    workgroupBarrier();
    sweep_and_move(tile, own, edges, first, lane);
}
