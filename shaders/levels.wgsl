// Coarse levels that one workgroup holds together: the finest of them is there; the others are averaged from it, and swept
// one after another, the coarsest first. See src/levels.rs.

override LANES: u32 = 64u;
// Aggregates of all levels here, the levels, and the colours of all of them.
override ROOM: u32 = 64u;
override LEVELS: u32 = 1u;
override ROUNDS: u32 = 6u;
// The number of the first aggregate here.
override BASE: u32 = 0u;

// For each colour, in the order of sweeping, where its edges start, and the end; for each level where its aggregates and, in
// that order, its colours start, and the ends; for each aggregate the one it is in; where its members start, and the end;
// members and their shares; edges. What is an aggregate is its place here.
@group(1) @binding(0) var<storage, read> table: array<u32>;
@group(1) @binding(1) var<storage, read> centers: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> predicted: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> shift: array<vec4f>;

var<workgroup> at: array<vec4f, ROOM>;
var<workgroup> by: array<vec4f, ROOM>;

struct Stored {
    ends: u32,
    inverse_rest: u32,
    inverse_weight: u32,
    // How many there are of its colour.
    width: u32,
}

override AT_LEVELS: u32 = ROUNDS + 1u;
override AT_LABELS: u32 = AT_LEVELS + 2u * (LEVELS + 1u);
override AT_SPANS: u32 = AT_LABELS + ROOM;
override AT_MEMBERS: u32 = AT_SPANS + ROOM + 1u;

fn fetch(round: u32, k: u32) -> Stored {
    let first = table[min(round, ROUNDS)];
    let width = (table[min(round + 1u, ROUNDS)] - first) / 3u;
    let at = first + k;
    return Stored(table[at], table[at + width], table[at + 2u * width], width);
}

// A colour's edges: the lane's first, and those that it has beside.
fn sweep(round: u32, first: Stored, lane: u32) {
    if lane < first.width {
        correct(first);
    }
    for (var k = lane + LANES; k < first.width; k += LANES) {
        correct(fetch(round, k));
    }
}

fn correct(stored: Stored) {
    let a = stored.ends & 0xffffu;
    let b = stored.ends >> 16u;
    let edge = Edge(a, b, bitcast<f32>(stored.inverse_rest), bitcast<f32>(stored.inverse_weight));
    let x_a = at[a];
    let x_b = at[b];
    let u_a = by[a];
    let u_b = by[b];
    let impulse = project_coarse(x_a.xyz - x_b.xyz, u_a.xyz - u_b.xyz, edge);
    by[a] = u_a + vec4f(impulse * x_a.w, 0.0);
    by[b] = u_b - vec4f(impulse * x_b.w, 0.0);
}

// The level whose turn it is in a round. What those before it were corrected by has been handed down to it.
fn level_of(round: u32, before: u32, lane: u32) -> u32 {
    var level = before;
    while level > 0u && round >= table[AT_LEVELS + LEVELS + 1u + level] {
        // Whatever the level above does not need any more: from here on it holds what it was corrected by.
        for (var k = table[AT_LEVELS + level] + lane; k < table[AT_LEVELS + level + 1u]; k += LANES) {
            by[k] -= predicted[BASE + k];
        }
        workgroupBarrier();
        level--;
        for (var k = table[AT_LEVELS + level] + lane; k < table[AT_LEVELS + level + 1u]; k += LANES) {
            by[k] += by[table[AT_LABELS + k]];
        }
        workgroupBarrier();
    }
    return level;
}

@compute @workgroup_size(LANES)
fn sweep_of_levels(@builtin(local_invocation_index) lane: u32) {
    var first = fetch(0u, lane);
    var second = fetch(1u, lane);
    var third = fetch(2u, lane);
    var fourth = fetch(3u, lane);
    let finest = table[AT_LEVELS + 1u];
    for (var k = lane; k < finest; k += LANES) {
        at[k] = centers[BASE + k];
        by[k] = predicted[BASE + k];
    }
    workgroupBarrier();
    for (var level = 1u; level < LEVELS; level++) {
        for (var k = table[AT_LEVELS + level] + lane; k < table[AT_LEVELS + level + 1u]; k += LANES) {
            let start = table[AT_SPANS + k];
            let end = table[AT_SPANS + k + 1u];
            let w = centers[BASE + k].w;
            let origin = at[table[AT_MEMBERS + 2u * start]].xyz;
            var dx = vec3f();
            var u = vec3f();
            for (var m = start; m < end; m++) {
                let item = table[AT_MEMBERS + 2u * m];
                let share = bitcast<f32>(table[AT_MEMBERS + 2u * m + 1u]);
                dx += (at[item].xyz - origin) * share;
                u += by[item].xyz * share;
            }
            at[k] = vec4f(origin + dx, w);
            by[k] = vec4f(u, 0.0);
            predicted[BASE + k] = vec4f(u, 0.0);
        }
        workgroupBarrier();
    }
    storageBarrier();
    // Rounds, four at a time as in patch.wgsl: a round is a colour of the level that is its turn.
    var level = LEVELS - 1u;
    for (var round = 0u; round < ROUNDS; round += 4u) {
        level = level_of(round, level, lane);
        sweep(round, first, lane);
        first = fetch(round + 4u, lane);
        workgroupBarrier();
        if round + 1u < ROUNDS {
            level = level_of(round + 1u, level, lane);
            sweep(round + 1u, second, lane);
            second = fetch(round + 5u, lane);
            workgroupBarrier();
        }
        if round + 2u < ROUNDS {
            level = level_of(round + 2u, level, lane);
            sweep(round + 2u, third, lane);
            third = fetch(round + 6u, lane);
            workgroupBarrier();
        }
        if round + 3u < ROUNDS {
            level = level_of(round + 3u, level, lane);
            sweep(round + 3u, fourth, lane);
            fourth = fetch(round + 7u, lane);
            workgroupBarrier();
        }
    }
    _ = level_of(ROUNDS, level, lane);
    for (var k = lane; k < finest; k += LANES) {
        shift[BASE + k] = by[k] - predicted[BASE + k];
    }
}
