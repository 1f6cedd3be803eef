// The sums of a vertex.
//
// Contributions of pairs to vertices are summed as integers, because their sum does not depend on the order. A
// thickness is 2^23 of them, so sums may reach 256 thicknesses; or 2^18, where they may reach 8192.

fn add_units(v: u32, first: u32, units: vec3i) {
    for (var k = 0u; k < 3u; k++) {
        atomicAdd(&sums[SUMS * v + first + k], units[k]);
    }
}

// Three sums, as a vector [m]; a thickness is so many units.
fn summed(v: u32, first: u32, unit: f32) -> vec3f {
    let units = vec3i(
        atomicLoad(&sums[SUMS * v + first]),
        atomicLoad(&sums[SUMS * v + first + 1u]),
        atomicLoad(&sums[SUMS * v + first + 2u]),
    );
    return vec3f(units) * (contact_params.thickness / unit);
}

// Begins truncation: stores how far a vertex moves relative to the common motion, after the response, and the share of it with
// which it moves by at most `most` [m].
fn begin_truncation(i: u32, most: f32) {
    let way = way_with(i, vertices[i].push.xyz);
    let share = select(1.0, most / length(way), length(way) > most && vertices[i].x.w > 0.0);
    vertices[i].way = vec4f(without_turning(way), most);
    atomicStore(&sums[SUMS * i + SHARE], bitcast<i32>(share));
    atomicStore(&sums[SUMS * i + CUT], 0);
    if share < 1.0 {
        atomicStore(&contact_state.status.shortens, 1u);
    }
}
