// Tiles of vertices, as src/gpu/tiles.rs lays them out.
// Every tile has as much room as any needs: so all is where it is, and no lane waits for memory to learn where to look.

// Invocations of a workgroup, vertices and edges of a color that a tile has room for, colors, and tiles.
override LANES: u32 = 64u;
override ROOM: u32 = 64u;
override WIDTH: u32 = 64u;
override COLORS: u32 = 6u;
override TILES: u32 = 1u;

// For each tile how many vertices are its own; then for each its vertices, its own first; then for each the aggregates
// that those are in; then for each its edges.
@group(1) @binding(0) var<storage, read> table: array<u32>;

fn own_vertices(tile: u32) -> u32 {
    return table[tile];
}

fn vertex_at(tile: u32, k: u32) -> u32 {
    return table[TILES + tile * ROOM + k];
}

fn label_at(tile: u32, k: u32) -> u32 {
    return table[TILES * (1u + ROOM) + tile * ROOM + k];
}

fn edges_of(tile: u32) -> ColoredEdges {
    return ColoredEdges(TILES * (1u + 2u * ROOM) + 3u * WIDTH * COLORS * tile, WIDTH, COLORS);
}
