// Shared by every stage: the numbers of a step and of a substep, and how an invocation finds its item.
// The structs mirror src/kernels.rs member for member; src/layout.rs compares them.

struct Params {
    acceleration: vec3f,
    h: f32,
    wind: vec3f,
    half_density: f32,
    drag: f32,
    lift: f32,
    fraction: f32,
    vertices: u32,
    bodies: u32,
    pins: u32,
    damped: u32,
    predicted: u32,
    substeps: u32,
    sweeps: u32,
    relaxed: u32,
    levels: u32,
}

struct Substep {
    carry: f32,
    gain: f32,
    rate: f32,
    start: f32,
    end: f32,
}

struct Span {
    start: u32,
    end: u32,
}

// A run of items.
struct Batch {
    first: u32,
    count: u32,
}

// Of what is in no aggregate.
const NO_LABEL: u32 = 0xffffffffu;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> substep: Substep;

const WORKGROUP: u32 = 64u;

// Large dispatches are folded into two dimensions: one holds 65535 workgroups.
fn item(id: vec3u, groups: vec3u) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}
