// A substep of one tile in workgroup memory: what plain, bent and corrected tiles share. Besides its own vertices, the
// workgroup holds a halo: all vertices on which they depend through the colors of the sweep. It recomputes the halo
// without storing it. So no workgroup waits for another, and the result is the same as if the colors were swept one after
// another over the whole cloth.

@group(1) @binding(1) var<storage, read> x: array<vec4f>;
// The last displacements, or this substep's if a prediction stage ran.
@group(1) @binding(2) var<storage, read> motion: array<vec4f>;
@group(1) @binding(3) var<storage, read> bodies: array<Body>;
@group(1) @binding(4) var<storage, read_write> x_out: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> p_out: array<vec4f>;
@group(1) @binding(7) var<storage, read_write> found: Defects;

// The word of the table where the pins begin: for each vertex its index among the pins, then the pins that follow
// targets.
override PINS: u32 = 0u;

fn position_at(k: u32) -> vec3f {
    return tile_x[k].xyz;
}

fn vector_in_table(at: u32) -> vec3f {
    return vec3f(bitcast<f32>(table[at]), bitcast<f32>(table[at + 1u]), bitcast<f32>(table[at + 2u]));
}

fn pin_of(v: u32) -> Pin {
    let at = PINS + params.vertices + 8u * table[PINS + v];
    return Pin(vector_in_table(at), v, vector_in_table(at + 4u), 0u);
}

// The displacement of a vertex without forces and constraints.
fn free_displacement(v: u32, x_v: vec4f, p_v: vec3f) -> vec3f {
    if x_v.w != 0.0 {
        return predict_displacement(p_v, substep);
    }
    if params.pins != 0u && table[PINS + v] != NONE {
        return pin_displacement(pin_of(v), x_v.xyz, substep);
    }
    return vec3f();
}

// Sweeps the edges of a tile, given the prefetched first ones, and moves its own vertices.
fn sweep_and_move(tile: u32, own: u32, edges: ColoredEdges, first: FourColors, lane: u32) {
    let checks = params.checks != 0u && substep.end == 1.0 && found.stopped == 0u;
    if checks {
        // As they are before the last substep, because this workgroup does not know where other tiles' vertices go in it.
        check_edges(tile, IN_TILES, lane);
    }
    sweep(edges, first, lane);
    for (var k = lane; k < own; k += LANES) {
        let v = vertex_at(tile, k);
        let x_v = tile_x[k];
        let path = after_contact(v, x_v, tile_u[k].xyz, substep);
        x_out[v] = vec4f(path.x + path.u, x_v.w);
        p_out[v] = vec4f(path.u, params.h);
        if checks {
            check_vertex(v, path.x + path.u, path.u, x_v.w);
        }
    }
}
