// A substep of one tile with a single coarse level, which the tile corrects itself: it also holds the aggregates of its
// vertices and all others on which these depend through the colors of the level, in the memory that afterwards holds the
// vertices. So the level takes no dispatch of its own, and the result is the same as if it did. Each vertex has an invocation
// of its own, which fetches it before anything else.

// The word of the table where the tiles of the level begin, which have the layout of those of vertices; the aggregates that
// one has room for, the edges per color, and the colors.
override LEVEL_TABLE: u32 = 0u;
override LEVEL_ROOM: u32 = 64u;
override LEVEL_WIDTH: u32 = 64u;
override LEVEL_COLORS: u32 = 6u;

// Of the aggregates of the level.
@group(1) @binding(6) var<storage, read> averages: array<Average>;

// The predicted displacement of each aggregate, and at the end its correction, to be read for the tile's own vertices.
var<workgroup> of_level: array<vec4f, LEVEL_ROOM>;

// Whether the tile holds aggregates.
var<private> on_level: bool;

fn impulse_of(d0: vec3f, du: vec3f, w: f32, edge: Edge) -> vec3f {
    if on_level {
        return coarse_impulse(d0, du, of_level[edge.a].xyz - of_level[edge.b].xyz, w, edge);
    }
    return project_edge(d0, du, edge);
}

fn aggregate_at(tile: u32, k: u32) -> u32 {
    return table[LEVEL_TABLE + TILES + tile * LEVEL_ROOM + k];
}

fn edges_of_level(tile: u32) -> ColoredEdges {
    let start = LEVEL_TABLE + TILES * (1u + 2u * LEVEL_ROOM) + 3u * LEVEL_WIDTH * LEVEL_COLORS * tile;
    return ColoredEdges(start, LEVEL_WIDTH, LEVEL_COLORS);
}

@compute @workgroup_size(LANES)
fn substep_of_corrected_tile(me: Invocation, group: Workgroup) {
    let tile = number_of(group);
    if tile >= TILES {
        return;
    }
    let edges_above = edges_of_level(tile);
    let first_above = fetch_four(edges_above, 0u, me.lane);
    let edges = edges_of(tile);
    let first = fetch_four(edges, 0u, me.lane);
    let own = own_vertices(tile);
    let k = min(me.lane, ROOM - 1u);
    let v = vertex_at(tile, k);
    let label = label_at(tile, k);
    let x_v = x[v];
    var u_v = motion[v].xyz;
    for (var k = me.lane; k < LEVEL_ROOM; k += LANES) {
        let average = averages[aggregate_at(tile, k)];
        tile_x[k] = average.x;
        tile_u[k] = average.u;
        of_level[k] = average.u;
    }
    if params.predicted == 0u {
        u_v = free_displacement(v, x_v, u_v);
    }
    workgroupBarrier();
    on_level = true;
    sweep(edges_above, first_above, me.lane);
    on_level = false;
    for (var k = me.lane; k < LEVEL_ROOM; k += LANES) {
        of_level[k] = tile_u[k] - of_level[k];
    }
    workgroupBarrier();
    if me.lane < ROOM {
        tile_x[k] = x_v;
        tile_u[k] = vec4f(u_v + of_level[label].xyz, 0.0);
    }
    workgroupBarrier();
    sweep_and_move(tile, own, edges, first, me.lane);
}
