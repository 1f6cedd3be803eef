// Patches of vertices, as src/gpu/patches.rs lays them out.

// Invocations of a workgroup, vertices that it has room for, colours of the edges, and patches in the table.
override LANES: u32 = 64u;
override ROOM: u32 = 64u;
override COLORS: u32 = 6u;
override PATCHES: u32 = 1u;

// How many edges of the colours before a colour there is room for in each patch; then for each patch how many vertices
// are its own and how many it holds; then for each its vertices, its own first; then for each its edges.
@group(1) @binding(0) var<storage, read> table: array<u32>;

override COUNTS: u32 = COLORS + 1u;

fn own_vertices(patch_index: u32) -> u32 {
    return table[COUNTS + 2u * patch_index];
}

fn all_vertices(patch_index: u32) -> u32 {
    return table[COUNTS + 2u * patch_index + 1u];
}

fn vertex_at(patch_index: u32, k: u32) -> u32 {
    return table[COUNTS + 2u * PATCHES + patch_index * ROOM + k];
}

const NO_EDGE: u32 = 0xffffffffu;

// Room for edges of a colour.
fn width_of(color: u32) -> u32 {
    return table[color + 1u] - table[color];
}

// The edge number k of a colour, its ends being places in the patch's list of vertices. Where there is none, and past the
// last colour, both are NO_EDGE.
fn edge_at(patch_index: u32, color: u32, k: u32) -> Edge {
    if color >= COLORS {
        return Edge(NO_EDGE, NO_EDGE, 0.0, 0.0);
    }
    let first = table[color];
    let width = table[color + 1u] - first;
    if k >= width {
        return Edge(NO_EDGE, NO_EDGE, 0.0, 0.0);
    }
    let edges = COUNTS + PATCHES * (2u + ROOM);
    let at = edges + 3u * (patch_index * table[COLORS] + first) + k;
    let ends = table[at];
    if ends == NO_EDGE {
        return Edge(NO_EDGE, NO_EDGE, 0.0, 0.0);
    }
    return Edge(ends & 0xffffu, ends >> 16u, bitcast<f32>(table[at + width]), bitcast<f32>(table[at + 2u * width]));
}
