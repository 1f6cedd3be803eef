// The parameters of a step and of a substep, shared by all stages. The structs mirror src/kernels/params.rs member for
// member; tests/unit/gpu_layout.rs compares them.

struct Params {
    wind: vec3f,
    h: f32,
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
    drift: vec3f,
    coarse_rule: u32,
    levels: u32,
    edges: u32,
    per_length: f32,
    per_mass: f32,
    longest_edge: f32,
    tethers: u32,
    load: f32,
    checks: u32,
    up: vec3f,
    per_slack: f32,
    padding: vec3f,
    used: u32,
}

struct Substep {
    fall: vec3f,
    carry: f32,
    gain: f32,
    rate: f32,
    start: f32,
    end: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<uniform> substep: Substep;
