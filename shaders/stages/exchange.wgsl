// Exchange with the CPU in the hybrid engine: three floats per vertex, in memory that both can access.

// What the CPU has sent: positions, if any, followed by displacements, if any.
override POSITIONS: bool = true;
override DISPLACEMENTS: bool = true;

@group(1) @binding(0) var<storage, read> outbox: array<f32>;
@group(1) @binding(1) var<storage, read_write> x: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> p: array<vec4f>;
@group(1) @binding(3) var<storage, read> u: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> inbox: array<f32>;

fn sent(i: u32) -> vec3f {
    return vec3f(outbox[3u * i], outbox[3u * i + 1u], outbox[3u * i + 2u]);
}

// If the vertices only moved by their displacements, these are enough.
@compute @workgroup_size(WORKGROUP)
fn arrive(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices {
        return;
    }
    if DISPLACEMENTS {
        p[i] = vec4f(sent(params.vertices + i), 0.0);
    }
    if POSITIONS {
        x[i] = vec4f(sent(i), x[i].w);
    } else {
        x[i] += vec4f(p[i].xyz, 0.0);
    }
}

// One float per invocation, so that writes to memory across the bus fill whole cache lines.
@compute @workgroup_size(WORKGROUP)
fn leave(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let k = item(id, groups);
    if k < 3u * params.vertices {
        inbox[k] = u[k / 3u][k % 3u];
    }
}
