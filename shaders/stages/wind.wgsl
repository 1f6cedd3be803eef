// Aerodynamic forces per triangle, gathered by each vertex from the triangles around it.

@group(1) @binding(0) var<storage, read> panels: array<Panel>;
@group(1) @binding(1) var<storage, read> spans: array<Span>;
@group(1) @binding(2) var<storage, read> around: array<u32>;
@group(1) @binding(3) var<storage, read> x: array<vec4f>;
@group(1) @binding(4) var<storage, read> p: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> u: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn wind(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= params.vertices || x[i].w == 0.0 {
        return;
    }
    var force = vec3f();
    for (var k = spans[i].start; k < spans[i].end; k++) {
        let panel = panels[around[k]];
        let c = panel.corners;
        let velocity = (p[c.x].xyz + p[c.y].xyz + p[c.z].xyz) * (substep.rate / 3.0);
        force += wind_force(x[c.x].xyz, x[c.y].xyz, x[c.z].xyz, velocity, panel.mass, substep) / 3.0;
    }
    u[i] += vec4f(force * (x[i].w * substep.gain), 0.0);
}
