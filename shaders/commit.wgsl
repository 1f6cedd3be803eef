// Once a step: keep the state if it is within bounds, else go back to the last good one. Nothing is read back for it.

@group(1) @binding(0) var<storage, read_write> x: array<vec4f>;
@group(1) @binding(1) var<storage, read_write> p: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> x_good: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> p_good: array<vec4f>;
// The first vertex that is not; all ones if none.
@group(1) @binding(4) var<storage, read_write> first_bad: atomic<u32>;

const NONE: u32 = 0xffffffffu;

// Farther out [m] squares soon overflow; NaN and infinity are farther still. Compared by its bits, in which magnitudes
// are ordered: a shader compiler may assume that no value is NaN.
const MAX_POSITION: f32 = 1e15;

fn is_bounded(v: vec3f) -> bool {
    return all((bitcast<vec3u>(v) & vec3u(0x7fffffffu)) <= vec3u(bitcast<u32>(MAX_POSITION)));
}

@compute @workgroup_size(WORKGROUP)
fn check(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices {
        return;
    }
    if !(is_bounded(x[i].xyz) && is_bounded(p[i].xyz)) {
        atomicMin(&first_bad, i);
    }
}

@compute @workgroup_size(WORKGROUP)
fn commit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices {
        return;
    }
    if atomicLoad(&first_bad) == NONE {
        x_good[i] = x[i];
        p_good[i] = p[i];
    } else {
        x[i] = x_good[i];
        p[i] = p_good[i];
    }
}
