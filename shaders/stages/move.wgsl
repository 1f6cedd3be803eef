// The end of a substep for one vertex: its tether (`tether_of`), then contact with every body of `bodies`, and friction.

// From where a vertex is, its inverse mass behind, and its displacement as the edges left it.
fn after_contact(v: u32, x: vec4f, u: vec3f, substep: Substep) -> Path {
    var path = Path(x.xyz, u);
    if x.w > 0.0 {
        if params.tethers != 0u {
            path.u += held(x.xyz, u, tether_of(v), substep);
        }
        for (var k = 0u; k < params.bodies; k++) {
            path = contact_body(path.x, path.u, bodies[k], substep);
        }
    }
    return path;
}

// What a vertex is moved by toward the pin that its tether hangs on, which is led as pins are. Behind the bodies are the pins.
fn held(x: vec3f, u: vec3f, tether: Tether, substep: Substep) -> vec3f {
    if tether.share == 0.0 {
        return vec3f();
    }
    let anchor = bodies[params.bodies + tether.anchor];
    let d0 = x - (anchor.a + anchor.a_travel * substep.start);
    return tethered(d0, u - anchor.a_travel * params.fraction, tether.length + tether.slack * params.load, tether.share);
}
