// A substep of one tile in workgroup memory. Besides its own vertices, the workgroup holds a halo: all vertices on
// which they depend through the colors of the sweep. It recomputes the halo without storing it. So no workgroup waits
// for another, and the result is the same as if the colors were swept one after another over the whole cloth.

@group(1) @binding(1) var<storage, read> x: array<vec4f>;
// The last displacements, or this substep's if a prediction stage ran.
@group(1) @binding(2) var<storage, read> motion: array<vec4f>;
@group(1) @binding(3) var<storage, read> bodies: array<Body>;
@group(1) @binding(4) var<storage, read_write> x_out: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> p_out: array<vec4f>;
// The correction of each aggregate of the finest coarse level.
@group(1) @binding(6) var<storage, read> shift: array<vec4f>;
@group(1) @binding(7) var<storage, read_write> found: Found;

fn impulse_of(d0: vec3f, du: vec3f, edge: Edge) -> vec3f {
    return project_edge(d0, du, edge);
}

fn position_at(k: u32) -> vec3f {
    return tile_x[k].xyz;
}

@compute @workgroup_size(LANES)
fn substep_of_tile(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let tile = group.x + group.y * groups.x;
    if tile >= TILES {
        return;
    }
    let edges = edges_of(tile);
    let first = fetch_four(edges, 0u, lane);
    let own = own_vertices(tile);
    for (var k = lane; k < ROOM; k += LANES) {
        let v = vertex_at(tile, k);
        let x_v = x[v];
        let motion_v = motion[v].xyz;
        var corrected = vec3f();
        if params.levels != 0u {
            corrected = shift[label_at(tile, k)].xyz;
        }
        tile_x[k] = x_v;
        tile_u[k] = vec4f(motion_displacement(motion_v, x_v.w, substep) + corrected, 0.0);
    }
    workgroupBarrier();
    let looks = params.checks != 0u && substep.end == 1.0 && found.stopped == 0u;
    if looks {
        // As they are before the last substep, because this workgroup does not know where other tiles' vertices go in it.
        look_at_edges(tile, IN_TILES, lane);
    }
    sweep(edges, first, lane);
    for (var k = lane; k < own; k += LANES) {
        let v = vertex_at(tile, k);
        let x_v = tile_x[k];
        let path = after_contact(v, x_v, tile_u[k].xyz, substep);
        x_out[v] = vec4f(path.x + path.u, x_v.w);
        p_out[v] = vec4f(path.u, params.h);
        if looks {
            look_at_vertex(v, path.x + path.u, path.u, x_v.w);
        }
    }
}
