// Bending of a vertex's one-ring. The derivations are in src/kernels/bending.rs.

struct BendRow {
    stiffness: f32,
    tau: f32,
    diagonal: f32,
}

struct BendEntry {
    other: u32,
    forward: f32,
    backward: f32,
}

// One pass of the Chebyshev filter that keeps stiff bending stable at few substeps: see src/step/bending.rs. A gain of
// 0 means that there is no filter.
struct BendPass {
    carry: f32,
    gain: f32,
    trial: f32,
    last: u32,
}

// A moment after a pass, and its change in the pass.
struct Passed {
    moment: vec3f,
    change: vec3f,
}

// The moment of a vertex's row, and the couple that cancels the torque of its damping.
struct Moment {
    moment: vec3f,
    couple: vec3f,
}

// What a row needs to know of its one-ring; `products` are the elements xy, xz, yz of the inertia.
struct Ring {
    y: vec3f,
    y_rate: vec3f,
    spin: vec3f,
    inertia: vec3f,
    products: vec3f,
}

struct Spin {
    omega: vec3f,
    in_line: bool,
}

// Adds the neighbor at offset `d`, which changes at `rate`, with its coefficient in the row.
fn add_neighbor(ring: ptr<function, Ring>, d: vec3f, rate: vec3f, coefficient: f32) {
    (*ring).y += d * coefficient;
    (*ring).y_rate += rate * coefficient;
    (*ring).spin += cross(d, rate);
    (*ring).inertia += vec3f(d.y * d.y + d.z * d.z, d.x * d.x + d.z * d.z, d.x * d.x + d.y * d.y);
    (*ring).products -= vec3f(d.x * d.y, d.x * d.z, d.y * d.z);
}

// The moment: stiffness times y, plus damping times dy/dt, where the rate is relative to the ring's own rotation.
fn bend_moment(ring: Ring, stiffness: f32, damping: f32) -> Moment {
    if damping == 0.0 {
        return Moment(ring.y * stiffness, vec3f());
    }
    let turn = unspin(ring.inertia, ring.products, ring.spin);
    if turn.in_line {
        let growth = dot(ring.y, ring.y_rate) / max(dot(ring.y, ring.y), 1e-30);
        return Moment(ring.y * (stiffness + damping * growth), vec3f());
    }
    let resisted = (ring.y_rate - cross(turn.omega, ring.y)) * damping;
    let couple = unspin(ring.inertia, ring.products, cross(ring.y, resisted)).omega;
    return Moment(ring.y * stiffness + resisted, couple);
}

// The moment after a pass. `bent` is the curvature normal of the tentatively displaced ring.
fn next_moment(moment: vec3f, change: vec3f, bent: vec3f, stiffness: f32, bend_pass: BendPass) -> Passed {
    let next = change * bend_pass.carry + bent * (stiffness * bend_pass.gain);
    return Passed(moment + next, next);
}

// The sum of the couples acting between a vertex and a neighbor: each row's couple acts only on the members of its
// ring.
fn couple_of(own: vec3f, other: vec3f, entry: BendEntry) -> vec3f {
    return own * select(1.0, 0.0, entry.forward == 0.0) + other * select(1.0, 0.0, entry.backward == 0.0);
}

// Solves I omega = spin for a symmetric inertia, unless the ring is nearly in one line.
fn unspin(inertia: vec3f, products: vec3f, spin: vec3f) -> Spin {
    let scale = 1.0 / max(inertia.x + inertia.y + inertia.z, 1e-30);
    let i = inertia * scale;
    let q = products * scale;
    let diagonal = vec3f(i.y * i.z - q.z * q.z, i.x * i.z - q.y * q.y, i.x * i.y - q.x * q.x);
    let corners = vec3f(q.y * q.z - q.x * i.z, q.x * q.z - q.y * i.y, q.x * q.y - q.z * i.x);
    let determinant = i.x * diagonal.x + q.x * corners.x + q.y * corners.y;
    if determinant < 1e-4 {
        return Spin(vec3f(), true);
    }
    let omega = vec3f(
        diagonal.x * spin.x + corners.x * spin.y + corners.y * spin.z,
        corners.x * spin.x + diagonal.y * spin.y + corners.z * spin.z,
        corners.y * spin.x + corners.z * spin.y + diagonal.z * spin.z,
    );
    return Spin(omega * (scale / determinant), false);
}
