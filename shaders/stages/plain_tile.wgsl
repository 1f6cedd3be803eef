// A substep of one tile without forces, or with displacements that a stage before has predicted.

// The correction of each aggregate of the finest coarse level.
@group(1) @binding(6) var<storage, read> shift: array<vec4f>;

fn impulse_of(d0: vec3f, du: vec3f, w: f32, edge: Edge) -> vec3f {
    return project_edge(d0, du, edge);
}

@compute @workgroup_size(LANES)
fn substep_of_tile(me: Invocation, group: Workgroup) {
    let tile = number_of(group);
    if tile >= TILES {
        return;
    }
    let edges = edges_of(tile);
    let first = fetch_four(edges, 0u, me.lane);
    let own = own_vertices(tile);
    for (var k = me.lane; k < ROOM; k += LANES) {
        let v = vertex_at(tile, k);
        let x_v = x[v];
        var u_v = motion[v].xyz;
        var corrected = vec3f();
        if params.levels != 0u {
            corrected = shift[label_at(tile, k)].xyz;
        }
        if params.predicted == 0u {
            u_v = free_displacement(v, x_v, u_v);
        }
        tile_x[k] = x_v;
        tile_u[k] = vec4f(u_v + corrected, 0.0);
    }
    workgroupBarrier();
    sweep_and_move(tile, own, edges, first, me.lane);
}
