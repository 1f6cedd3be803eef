// A sweep over a tile's edges in workgroup memory. The including shader defines the impulse of an edge (`impulse_of`).

// Positions with inverse masses of all vertices (or aggregates) that the tile holds.
var<workgroup> tile_x: array<vec4f, ROOM>;
// Displacements of the same.
var<workgroup> tile_u: array<vec4f, ROOM>;

fn correct(edge: Edge) {
    let x_a = tile_x[edge.a];
    let x_b = tile_x[edge.b];
    let u_a = tile_u[edge.a];
    let u_b = tile_u[edge.b];
    let impulse = impulse_of(x_a.xyz - x_b.xyz, u_a.xyz - u_b.xyz, x_a.w + x_b.w, edge);
    tile_u[edge.a] = u_a + vec4f(impulse * x_a.w, 0.0);
    tile_u[edge.b] = u_b - vec4f(impulse * x_b.w, 0.0);
}
