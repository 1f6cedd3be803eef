// The end of a substep for one vertex: contact with every body of `bodies`, and friction.

// From where a vertex is, its inverse mass behind, and its displacement as the edges left it.
fn after_contact(x: vec4f, u: vec3f, substep: Substep) -> Path {
    var path = Path(x.xyz, u);
    if x.w > 0.0 {
        for (var k = 0u; k < params.bodies; k++) {
            path = contact_body(path.x, path.u, bodies[k], substep);
        }
    }
    return path;
}
