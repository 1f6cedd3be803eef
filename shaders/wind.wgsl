// The aerodynamic force on a triangle. The derivations are in src/kernels/wind.rs.

struct Panel {
    corners: vec3u,
    mass: f32,
}

// k A, less where it would reverse the velocity relative to the air within the time for which it acts.
fn limited(k: f32, area: f32, mass: f32, substep: Substep) -> f32 {
    let kick = substep.gain / params.h;
    let per_share = 1.0 / max(kick * k * area / mass, 0.5);
    return k * area * per_share * (1.0 - 0.25 * per_share);
}

// Drag along the flow and lift across it (Keckeisen et al. 2004), combined as a normal and a tangential part.
fn wind_force(x0: vec3f, x1: vec3f, x2: vec3f, velocity: vec3f, mass: f32, substep: Substep) -> vec3f {
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
    let k_n = limited(params.half_density * (params.drag * abs(along) + params.lift * speed * (1.0 - sine * sine)), area, mass, substep);
    let k_t = limited(params.half_density * abs(along) * (params.drag - params.lift * sine), area, mass, substep);
    return -(normal * k_n + tangential * k_t);
}
