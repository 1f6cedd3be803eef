// Bending and prediction for a tile of vertices, with all passes in one dispatch, and averages for the finest level. Besides
// its own vertices, the workgroup holds the rings around them on which they depend through the passes. It recomputes those
// without storing them; each stage covers one ring less than the one before.

// Invocations of a workgroup, vertices that a tile has room for, and whether there are several passes. How many says the last
// of them.
override LANES: u32 = 64u;
override HELD: u32 = 64u;
override FILTERED: bool = false;

@group(1) @binding(4) var<storage, read> rows: array<BendRow>;
// For each tile, where the list of its rings, the list of its vertices, the slices of their entries and its aggregates start.
// The list of rings has their number, the number of the tile's own vertices, and the number of vertices up to the end of each
// ring. The list of vertices has one more ring, which the outermost one reads. The aggregates are in src/gpu/bend_tiles.rs.
@group(1) @binding(5) var<storage, read> table: array<u32>;
@group(1) @binding(6) var<uniform> bend_passes: array<BendPass, 16>;
// Of the aggregates of the finest level.
@group(1) @binding(7) var<storage, read_write> averages: array<Average>;

// The position and the last displacement of each vertex: a neighbor's would otherwise take two reads of memory, one
// after the other.
var<workgroup> held: array<array<f32, 6>, HELD>;

// Where the tile's list of vertices and its slices start.
var<private> list: u32;
var<private> slices: u32;

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
    return vec3f(held[k][0], held[k][1], held[k][2]);
}

fn bent_p(k: u32) -> vec3f {
    return vec3f(held[k][3], held[k][4], held[k][5]);
}

fn hold(k: u32) {
    let v = table[list + k];
    let x_k = x[v];
    let p_k = p[v];
    held[k] = array<f32, 6>(x_k.x, x_k.y, x_k.z, p_k.x, p_k.y, p_k.z);
}

// Predicts the displacement of a vertex under the moments.
fn displace(k: u32, ahead: Fetched) {
    let v = table[list + k];
    predict_item(v);
    if x[v].w != 0.0 {
        u[v] += vec4f(bend_force(k, ahead) * (x[v].w * substep.gain), 0.0);
    }
}

// The own vertices of a tile. Invocations fetch what they need for their first vertex before anything else, because memory
// takes longer to answer than all of bending to compute.
fn bend(tile: u32, lane: u32) {
    let ends = table[4u * tile] + 1u;
    list = table[4u * tile + 1u];
    slices = table[4u * tile + 2u];
    var ring = table[ends - 1u];
    let bent = table[ends + ring];
    let own = table[ends];
    let ahead = fetched(min(lane, bent - 1u));
    for (var k = lane; k < slices - list; k += LANES) {
        hold(k);
    }
    workgroupBarrier();
    if lane < bent {
        first_moment(lane, substep.rate, ahead);
    }
    for (var k = lane + LANES; k < bent; k += LANES) {
        first_moment(k, substep.rate, fetched(k));
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
    if lane < own {
        displace(lane, ahead);
    }
    for (var k = lane + LANES; k < own; k += LANES) {
        displace(k, fetched(k));
    }
    if tile == 0u {
        for (var pin = lane; pin < params.pins; pin += LANES) {
            predict_item(params.vertices + pin);
        }
    }
}

// Where the aggregates of a tile and the shares of its vertices start in the table, how many there are, and what concerns
// the first vertex of an invocation.
struct Aggregates {
    start: u32,
    shares: u32,
    count: u32,
    own: u32,
    first: u32,
    share: f32,
}

fn aggregates_of(tile: u32, lane: u32) -> Aggregates {
    let start = table[4u * tile + 3u];
    let count = table[start];
    let shares = start + 3u + 2u * count;
    let own = table[shares - 1u];
    let at = shares + 2u * min(lane, own - 1u);
    return Aggregates(start, shares, count, own, table[at], bitcast<f32>(table[at + 1u]));
}

// A vertex's part in the averages of its aggregate, whose first vertex is at `first`.
fn set_part(k: u32, first: u32, share: f32) {
    set_bend_vector(2u * k, (bent_x(k) - bent_x(first)) * share);
    set_bend_vector(2u * k + 1u, u[table[list + k]].xyz * share);
}

// Averages the positions and displacements of the tile's aggregates, as restrict.wgsl does.
fn average(aggregates: Aggregates, lane: u32) {
    // The moments are needed no more.
    workgroupBarrier();
    if lane < aggregates.own {
        set_part(lane, aggregates.first, aggregates.share);
    }
    for (var k = lane + LANES; k < aggregates.own; k += LANES) {
        set_part(k, table[aggregates.shares + 2u * k], bitcast<f32>(table[aggregates.shares + 2u * k + 1u]));
    }
    workgroupBarrier();
    for (var a = lane; a < aggregates.count; a += LANES) {
        let at = aggregates.start + 1u + 2u * a;
        let first = table[at + 1u];
        var sum = Average(vec4f(bent_x(first), averages[table[at]].x.w), vec4f());
        for (var k = first; k < table[at + 3u]; k++) {
            sum.x += vec4f(bend_vector(2u * k), 0.0);
            sum.u += vec4f(bend_vector(2u * k + 1u), 0.0);
        }
        averages[table[at]] = sum;
    }
}

// One dimension holds as many tiles as there may be.
@compute @workgroup_size(LANES)
fn bend_tile(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    bend(group.x, lane);
}

@compute @workgroup_size(LANES)
fn bend_and_average_tile(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let aggregates = aggregates_of(group.x, lane);
    bend(group.x, lane);
    average(aggregates, lane);
}
