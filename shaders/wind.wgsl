// Wind, a force per triangle, gathered by each vertex from the triangles around it.

struct Panel {
    corners: vec3u,
    mass: f32,
}

@group(1) @binding(0) var<storage, read> panels: array<Panel>;
@group(1) @binding(1) var<storage, read> spans: array<Span>;
@group(1) @binding(2) var<storage, read> around: array<u32>;
@group(1) @binding(3) var<storage, read> x: array<vec4f>;
@group(1) @binding(4) var<storage, read> p: array<vec4f>;
@group(1) @binding(5) var<storage, read_write> u: array<vec4f>;

// k / (1 + kick k A/m): exact for a free panel, never reverses the velocity relative to the air.
fn limited(k: f32, area: f32, mass: f32) -> f32 {
    let kick = substep.gain / params.h;
    return k * area / (1.0 + kick * k * area / mass);
}

// Drag along the stream and lift across it (Keckeisen et al. 2004), as a normal and a tangential part.
fn wind_force(x0: vec3f, x1: vec3f, x2: vec3f, velocity: vec3f, mass: f32) -> vec3f {
    let cross_product = cross(x1 - x0, x2 - x0);
    let double_area = length(cross_product);
    if double_area < 1e-20 {
        return vec3f();
    }
    let n = cross_product / double_area;
    let area = 0.5 * double_area;
    let relative = velocity - params.wind;
    let along = dot(n, relative);
    let normal = n * along;
    let tangential = relative - normal;
    let speed = max(length(relative), 1e-10);
    let sine = abs(along) / speed;
    let k_n = limited(params.half_density * (params.drag * abs(along) + params.lift * speed * (1.0 - sine * sine)), area, mass);
    let k_t = limited(params.half_density * abs(along) * (params.drag - params.lift * sine), area, mass);
    return -(normal * k_n + tangential * k_t);
}

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
        force += wind_force(x[c.x].xyz, x[c.y].xyz, x[c.z].xyz, velocity, panel.mass) / 3.0;
    }
    u[i] += vec4f(force * (x[i].w * substep.gain), 0.0);
}
