// Tiles of vertices, as laid out by src/gpu/tiles.rs. All tiles have room for the largest one, so addresses can be
// computed without waiting for memory.

// Invocations per workgroup.
override LANES: u32 = 64u;
// Vertices that a tile has room for.
override ROOM: u32 = 64u;
// Edges per color that a tile has room for.
override WIDTH: u32 = 64u;
// Number of colors.
override COLORS: u32 = 6u;
// Number of tiles.
override TILES: u32 = 1u;

// For each tile the number of its own vertices; then for each tile its vertices, own ones first; then for each tile the
// aggregates of those vertices; then for each tile its edges.
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
