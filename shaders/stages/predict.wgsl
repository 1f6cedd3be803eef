// The start of a substep: the displacement predicted from the last one and a uniform acceleration; pinned vertices
// follow their targets. x.w is the inverse mass, 0 where pinned. Per-vertex forces are added by their own stages.

@group(1) @binding(0) var<storage, read> x: array<vec4f>;
@group(1) @binding(1) var<storage, read> p: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> u: array<vec4f>;
@group(1) @binding(3) var<storage, read> pins: array<Pin>;

// Items are all vertices followed by all pins that follow targets; each displacement is written by only one of them.
fn predict_item(i: u32) {
    if i < params.vertices {
        if x[i].w != 0.0 {
            u[i] = vec4f(predict_displacement(p[i].xyz, substep), 0.0);
        } else if params.pins == 0u {
            u[i] = vec4f();
        }
    } else if i - params.vertices < params.pins {
        let pin = pins[i - params.vertices];
        u[pin.vertex] = vec4f(pin_displacement(pin, x[pin.vertex].xyz, substep), 0.0);
    }
}

@compute @workgroup_size(WORKGROUP)
fn predict(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    predict_item(item(id, groups));
}
