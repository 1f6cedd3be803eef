// Cloth that is pinched between what is led.

// Six times the signed volume [m³] of a tetrahedron.
fn volume(t: Four) -> f32 {
    return dot(cross(t.b - t.a, t.c - t.a), t.d - t.a);
}

// Where a vertex is at the end of the substep.
fn end_of(v: u32) -> vec3f {
    return vertices[v].x.xyz + vertices[v].push.xyz + vertices[v].u.xyz;
}

// Finds the pairs that may have moved through each other, among those whose plane has passed a vertex.
@compute @workgroup_size(WORKGROUP)
fn find_pinched(@builtin(local_invocation_index) lane: u32) {
    let count = atomicLoad(&known.status.passed);
    for (var k = lane; k < min(count, PASSED); k += WORKGROUP) {
        let v = known.passed[k];
        let ends = Four(end_of(v.x), end_of(v.y), end_of(v.z), end_of(v.w));
        if volume(positions(v)) * volume(ends) <= 0.0 {
            let at = atomicAdd(&known.status.pinched, 1u);
            if at < PINCHED {
                known.pinched[at] = v;
            }
        }
    }
    workgroupBarrier();
    if lane == 0u {
        atomicStore(&known.status.passed, 0u);
        if count > PASSED {
            atomicMax(&known.status.pinched, PINCHED + 1u);
        }
    }
}
