// A substep of one tile with bending in a single pass, and without coarse levels. Around the vertices that are swept, the tile
// holds those whose moments act on them, and one more ring on which these moments depend. Each vertex has an invocation of its
// own, which fetches its entries before anything else, because memory takes longer to answer than all of bending to compute.

// Most vertices of a tile that are swept.
override FORCED: u32 = 64u;
// Most entries of a vertex.
override RING: u32 = 8u;
// The words of the table where the rows of all vertices begin, and the entries of each tile: for each entry of a vertex
// the other vertices, then the forward coefficients, then the backward ones.
override ROWS: u32 = 0u;
override RINGS: u32 = 0u;

fn entry_stride() -> u32 {
    return BENT;
}

fn entries_of(tile: u32, k: u32) -> Entries {
    let start = RINGS + 3u * BENT * RING * tile;
    return Entries(k, start + k, start + 3u * BENT * RING);
}

fn row_of(v: u32) -> BendRow {
    let row = vector_in_table(ROWS + 3u * v);
    return BendRow(row.x, row.y, row.z);
}

fn bent_x(k: u32) -> vec3f {
    return tile_x[k].xyz;
}

fn bent_p(k: u32) -> vec3f {
    return tile_u[k].xyz;
}

fn impulse_of(d0: vec3f, du: vec3f, w: f32, edge: Edge) -> vec3f {
    return project_edge(d0, du, edge);
}

@compute @workgroup_size(LANES)
fn substep_of_bent_tile(me: Invocation, group: Workgroup) {
    let tile = number_of(group);
    if tile >= TILES {
        return;
    }
    let bent = min(me.lane, BENT - 1u);
    let entries = entries_of(tile, bent);
    let four = fetch_four_entries(entries, 0u);
    let next = fetch_four_entries(entries, 4u);
    let edges = edges_of(tile);
    let first = fetch_four(edges, 0u, me.lane);
    let own = own_vertices(tile);
    let k = min(me.lane, ROOM - 1u);
    let v = vertex_at(tile, k);
    let x_v = x[v];
    let p_v = motion[v].xyz;
    let row = row_of(v);
    if me.lane < ROOM {
        tile_x[k] = x_v;
        tile_u[k] = vec4f(p_v, 0.0);
    }
    workgroupBarrier();
    var moment = Moment();
    if me.lane < BENT {
        var ring = Ring();
        add_four_entries(&ring, k, substep.rate, four);
        add_four_entries(&ring, k, substep.rate, next);
        for (var index = 8u; index < RING; index++) {
            add_entry(&ring, k, substep.rate, fetch_entry(entries, index));
        }
        moment = bend_moment(ring, row.stiffness, row.stiffness * row.tau);
        set_bend_vector(place_of(MOMENT, k), moment.moment);
        set_bend_vector(place_of(COUPLE, k), moment.couple);
    }
    workgroupBarrier();
    if me.lane < FORCED {
        var u_v = free_displacement(v, x_v, p_v);
        if x_v.w != 0.0 {
            var force = moment.moment * -row.diagonal;
            force = force_of_four(force, k, moment.couple, four);
            force = force_of_four(force, k, moment.couple, next);
            for (var index = 8u; index < RING; index++) {
                force += force_of(k, moment.couple, fetch_entry(entries, index));
            }
            u_v += force * (x_v.w * substep.gain);
        }
        tile_u[k] = vec4f(u_v, 0.0);
    }
    workgroupBarrier();
    sweep_and_move(tile, own, edges, first, me.lane);
}
