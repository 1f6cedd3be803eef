// Stage 1: the displacement that the last one and a uniform acceleration predict; pinned vertices go where they are led.
// x.w is the inverse mass, 0 where pinned. Forces that differ from vertex to vertex are added by their own stages.

struct Pin {
    origin: vec3f,
    vertex: u32,
    goal: vec3f,
    padding: u32,
}

@group(1) @binding(0) var<storage, read> x: array<vec4f>;
@group(1) @binding(1) var<storage, read> p: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> u: array<vec4f>;
@group(1) @binding(3) var<storage, read> pins: array<Pin>;

// Leapfrog, exact for linear drag.
fn predict_displacement(p: vec3f, acceleration: vec3f) -> vec3f {
    return p * substep.carry + acceleration * substep.gain;
}

@compute @workgroup_size(WORKGROUP)
fn predict(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices {
        return;
    }
    if x[i].w == 0.0 {
        u[i] = vec4f();
        return;
    }
    u[i] = vec4f(predict_displacement(p[i].xyz, params.acceleration), 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn move_pins(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k >= params.pins {
        return;
    }
    let pin = pins[k];
    u[pin.vertex] = vec4f(pin.origin + (pin.goal - pin.origin) * substep.end - x[pin.vertex].xyz, 0.0);
}
