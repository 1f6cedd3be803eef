// Bending and prediction for a tile of vertices, with all passes in one dispatch. Besides its own vertices, the
// workgroup holds the rings around them on which they depend through the passes. It recomputes those without storing
// them; each stage covers one ring less than the one before.

// Invocations of a workgroup, vertices with moments that a tile has room for, numbers of these, numbers of all vertices
// that it holds, and whether there are several passes. How many says the last of them.
override LANES: u32 = 64u;
override ROOM: u32 = 64u;
override NUMBERS: u32 = 384u;
override HELD: u32 = 384u;
override FILTERED: bool = false;

@group(1) @binding(4) var<storage, read> rows: array<BendRow>;
// For each tile, where the list of its rings, the list of its vertices and the slices of their entries start. The list
// of rings has their number, the number of the tile's own vertices, and the number of vertices up to the end of each
// ring. The list of vertices has one more ring, which the outermost one reads.
@group(1) @binding(5) var<storage, read> table: array<u32>;
@group(1) @binding(6) var<uniform> bend_passes: array<BendPass, 16>;

var<workgroup> numbers: array<f32, NUMBERS>;
// The position and the last displacement of each vertex: a neighbor's would otherwise take two reads of memory, one
// after the other.
var<workgroup> held: array<f32, HELD>;

// Where the tile's list of vertices and its slices start.
var<private> list: u32;
var<private> slices: u32;

fn bend_room() -> u32 {
    return ROOM;
}

fn bend_vector(at: u32) -> vec3f {
    return vec3f(numbers[3u * at], numbers[3u * at + 1u], numbers[3u * at + 2u]);
}

fn set_bend_vector(at: u32, value: vec3f) {
    numbers[3u * at] = value.x;
    numbers[3u * at + 1u] = value.y;
    numbers[3u * at + 2u] = value.z;
}

fn ring_slices() -> u32 {
    return slices;
}

fn is_filtered() -> bool {
    return FILTERED;
}

fn bend_pass_at(index: u32) -> BendPass {
    return bend_passes[index];
}

fn row_of(k: u32) -> BendRow {
    return rows[table[list + k]];
}

fn bent_x(k: u32) -> vec3f {
    return vec3f(held[6u * k], held[6u * k + 1u], held[6u * k + 2u]);
}

fn bent_p(k: u32) -> vec3f {
    return vec3f(held[6u * k + 3u], held[6u * k + 4u], held[6u * k + 5u]);
}

fn hold(k: u32) {
    let v = table[list + k];
    let x_k = x[v];
    let p_k = p[v];
    held[6u * k] = x_k.x;
    held[6u * k + 1u] = x_k.y;
    held[6u * k + 2u] = x_k.z;
    held[6u * k + 3u] = p_k.x;
    held[6u * k + 4u] = p_k.y;
    held[6u * k + 5u] = p_k.z;
}

@compute @workgroup_size(LANES)
fn bend_tile(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    // One dimension holds as many tiles as there may be.
    let tile = group.x;
    let ends = table[3u * tile] + 1u;
    list = table[3u * tile + 1u];
    slices = table[3u * tile + 2u];
    for (var k = lane; k < slices - list; k += LANES) {
        hold(k);
    }
    workgroupBarrier();
    var ring = table[ends - 1u];
    for (var k = lane; k < table[ends + ring]; k += LANES) {
        first_moment(k, substep.rate);
    }
    workgroupBarrier();
    for (var index = 1u; FILTERED && bend_passes[index - 1u].last == 0u; index++) {
        for (var k = lane; k < table[ends + ring - 1u]; k += LANES) {
            trial_displacements(k, x[table[list + k]].w, bend_passes[index]);
        }
        workgroupBarrier();
        for (var k = lane; k < table[ends + ring - 2u]; k += LANES) {
            filter_moments(k, bend_passes[index]);
        }
        workgroupBarrier();
        ring -= 2u;
    }
    for (var k = lane; k < table[ends]; k += LANES) {
        let v = table[list + k];
        predict_item(v);
        if x[v].w != 0.0 {
            u[v] += vec4f(bend_force(k) * (x[v].w * substep.gain), 0.0);
        }
    }
    if tile == 0u {
        for (var pin = lane; pin < params.pins; pin += LANES) {
            predict_item(params.vertices + pin);
        }
    }
}
