// Patches of vertices, as src/gpu/patches.rs lays them out.
// Every patch has as much room as any needs: so all is where it is, and no lane waits for memory to learn where to look.

// Invocations of a workgroup, vertices and edges of a colour that a patch has room for, colours, and patches.
override LANES: u32 = 64u;
override ROOM: u32 = 64u;
override WIDTH: u32 = 64u;
override COLORS: u32 = 6u;
override PATCHES: u32 = 1u;

// For each patch how many vertices are its own; then for each its vertices, its own first; then for each the aggregates
// that those are in; then for each its edges.
@group(1) @binding(0) var<storage, read> table: array<u32>;

fn own_vertices(patch_index: u32) -> u32 {
    return table[patch_index];
}

fn vertex_at(patch_index: u32, k: u32) -> u32 {
    return table[PATCHES + patch_index * ROOM + k];
}

fn label_at(patch_index: u32, k: u32) -> u32 {
    return table[PATCHES * (1u + ROOM) + patch_index * ROOM + k];
}

fn edges_of(patch_index: u32) -> Runs {
    return Runs(PATCHES * (1u + 2u * ROOM) + 3u * WIDTH * COLORS * patch_index, WIDTH, COLORS);
}
