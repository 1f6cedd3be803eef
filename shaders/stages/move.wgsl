// The end of a substep for one vertex: its tether (`tether_of`), then collisions with all of `bodies`, including
// friction.

// `x` holds a vertex's position and inverse mass, `u` its displacement after the sweep.
fn after_contact(v: u32, x: vec4f, u: vec3f, substep: Substep) -> Path {
    var path = path_of(x.xyz, u);
    if x.w > 0.0 {
        if params.tethers != 0u {
            path.u += held(x.xyz, u, tether_of(v), substep);
        }
        for (var k = 0u; k < params.bodies; k++) {
            path = contact_body(path, bodies[k], substep);
        }
    }
    return path;
}

// The correction of a vertex by its tether. The pins that tethers are attached to follow the colliders in `bodies`.
fn held(x: vec3f, u: vec3f, tether: Tether, substep: Substep) -> vec3f {
    if tether.share == 0.0 {
        return vec3f();
    }
    let anchor = bodies[params.bodies + tether.anchor];
    let d0 = x - (anchor.a + anchor.a_travel * substep.start);
    return tethered(d0, u - anchor.a_travel * params.fraction, tether.length + tether.slack * params.load, tether.share);
}
