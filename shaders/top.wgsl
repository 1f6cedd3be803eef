// The coarse levels that fit into one workgroup, in workgroup memory. The finest of them has been averaged: from the memory
// that all share that is faster done by many.

override LANES: u32 = 64u;
// The number of the first aggregate here.
override BASE: u32 = 0u;

@group(1) @binding(0) var<storage, read> table: array<u32>;
@group(1) @binding(1) var<storage, read> centers: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> predicted: array<vec4f>;
// What each aggregate is corrected by.
@group(1) @binding(3) var<storage, read_write> shift: array<vec4f>;

var<workgroup> at: array<vec4f, AGGREGATES>;
var<workgroup> by: array<vec4f, AGGREGATES>;

fn center(k: u32) -> vec4f {
    return at[k];
}

fn set_center(k: u32, x: vec3f) {
    at[k] = vec4f(x, at[k].w);
}

fn coarse_by(k: u32) -> vec3f {
    return by[k].xyz;
}

fn set_coarse_by(k: u32, u: vec3f) {
    by[k] = vec4f(u, 0.0);
}

// Not asked for: see above.
fn below(k: u32) -> Item {
    return Item();
}

// Read by the lane that wrote it.
fn predicted_of(k: u32) -> vec3f {
    return predicted[BASE + k].xyz;
}

fn set_predicted(k: u32, u: vec3f) {
    predicted[BASE + k] = vec4f(u, 0.0);
}

fn correct(edge: Edge) {
    correct_coarse(edge);
}

fn before(color: u32, lane: u32) {
    descend(color, lane);
}

fn meet() {
    workgroupBarrier();
}

@compute @workgroup_size(LANES)
fn sweep_of_levels(@builtin(local_invocation_index) lane: u32) {
    let first = fetch_four(coarse_edges(), 0u, lane);
    for (var k = lane; k < AGGREGATES; k += LANES) {
        at[k] = centers[BASE + k];
        by[k] = predicted[BASE + k];
    }
    meet();
    restrict_levels(lane);
    sweep_levels(first, lane);
    for (var k = lane; k < FINEST; k += LANES) {
        shift[BASE + k] = vec4f(coarse_by(k) - predicted_of(k), 0.0);
    }
}
