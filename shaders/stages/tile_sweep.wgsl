// A sweep over a tile's edges in workgroup memory. A shader says which impulse an edge gives its ends (`impulse_of`).

// Positions (or centers) with inverse masses, and displacements, of all that the tile holds.
var<workgroup> tile_x: array<vec4f, ROOM>;
var<workgroup> tile_u: array<vec4f, ROOM>;

fn correct(edge: Edge) {
    let x_a = tile_x[edge.a];
    let x_b = tile_x[edge.b];
    let u_a = tile_u[edge.a];
    let u_b = tile_u[edge.b];
    let impulse = impulse_of(x_a.xyz - x_b.xyz, u_a.xyz - u_b.xyz, edge);
    tile_u[edge.a] = u_a + vec4f(impulse * x_a.w, 0.0);
    tile_u[edge.b] = u_b - vec4f(impulse * x_b.w, 0.0);
}

fn before(color: u32, lane: u32) {}
