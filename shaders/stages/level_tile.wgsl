// The sweep of a tile of aggregates, as tile.wgsl does for vertices: for coarse levels too large for one workgroup.

// The index of the level, 0 being the finest.
override LEVEL: u32 = 0u;

@group(1) @binding(1) var<storage, read> averages: array<Average>;
// The correction of each aggregate.
@group(1) @binding(2) var<storage, read_write> shift: array<vec4f>;

// The predicted displacements of all aggregates that the tile holds.
var<workgroup> tile_predicted: array<vec4f, ROOM>;

fn impulse_of(d0: vec3f, du: vec3f, w: f32, edge: Edge) -> vec3f {
    return coarse_impulse(d0, du, tile_predicted[edge.a].xyz - tile_predicted[edge.b].xyz, w, edge);
}

@compute @workgroup_size(LANES)
fn sweep_of_level_tile(me: Invocation, group: Workgroup) {
    let tile = number_of(group);
    if tile >= TILES {
        return;
    }
    let edges = edges_of(tile);
    let first = fetch_four(edges, 0u, me.lane);
    let own = own_vertices(tile);
    for (var k = me.lane; k < ROOM; k += LANES) {
        let v = vertex_at(tile, k);
        let above = label_at(tile, k);
        let average = averages[v];
        tile_x[k] = average.x;
        tile_u[k] = average.u;
        tile_predicted[k] = average.u;
        if LEVEL + 1u < params.levels {
            tile_u[k] += shift[above];
        }
    }
    workgroupBarrier();
    sweep(edges, first, me.lane);
    for (var k = me.lane; k < own; k += LANES) {
        shift[vertex_at(tile, k)] = tile_u[k] - tile_predicted[k];
    }
}
