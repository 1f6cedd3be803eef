// The coarse levels that fit into one workgroup's memory together. The finest of them was restricted by another
// dispatch: reading its many members from global memory is faster with many workgroups.

override LANES: u32 = 64u;
// The index of the first aggregate held here.
override BASE: u32 = 0u;

@group(1) @binding(0) var<storage, read> table: array<u32>;
@group(1) @binding(1) var<storage, read> averages: array<Average>;
// The correction of each aggregate.
@group(1) @binding(2) var<storage, read_write> shift: array<vec4f>;

var<workgroup> level_x: array<vec4f, AGGREGATES>;
var<workgroup> level_u: array<vec4f, AGGREGATES>;
var<workgroup> level_predicted: array<vec4f, AGGREGATES>;

fn center_of(k: u32) -> vec4f {
    return level_x[k];
}

fn set_center(k: u32, x: vec3f) {
    level_x[k] = vec4f(x, level_x[k].w);
}

fn corrected_of(k: u32) -> vec3f {
    return level_u[k].xyz;
}

fn set_corrected(k: u32, u: vec3f) {
    level_u[k] = vec4f(u, 0.0);
}

// Never called, because the finest level was restricted before.
fn below(k: u32) -> Item {
    return Item();
}

fn predicted_of(k: u32) -> vec3f {
    return level_predicted[k].xyz;
}

fn set_predicted(k: u32, u: vec3f) {
    level_predicted[k] = vec4f(u, 0.0);
}

fn correct(edge: Edge) {
    correct_coarse(edge);
}

@compute @workgroup_size(LANES)
fn sweep_of_levels(@builtin(local_invocation_index) lane: u32) {
    let skipped = first_in_use();
    let first = fetch_four(edges_in_use(skipped), 0u, lane);
    for (var k = lane; k < AGGREGATES; k += LANES) {
        let average = averages[BASE + k];
        level_x[k] = average.x;
        level_u[k] = average.u;
        level_predicted[k] = average.u;
    }
    workgroupBarrier();
    restrict_levels(lane);
    sweep_levels(skipped, first, lane);
    for (var k = lane; k < FINEST; k += LANES) {
        shift[BASE + k] = vec4f(corrected_of(k) - predicted_of(k), 0.0);
    }
}
