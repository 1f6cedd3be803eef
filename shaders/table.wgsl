// Patches of vertices, as src/gpu/patches.rs lays them out: a header each, then lists that the headers point into.

// Invocations of a workgroup, vertices that it has room for, colours of the edges, and patches in the table.
override LANES: u32 = 64u;
override ROOM: u32 = 64u;
override COLORS: u32 = 6u;
override PATCHES: u32 = 1u;

struct Patch {
    // Where its list of vertices starts, its own before those around them; how many are its own, and all.
    vertices: u32,
    own: u32,
    all: u32,
    // Where in the table the ends of its edges' colours stand.
    ends: u32,
    // Where its edges start.
    edges: u32,
}

@group(1) @binding(0) var<storage, read> table: array<u32>;

fn patch_at(index: u32) -> Patch {
    let at = index * (4u + COLORS);
    return Patch(table[at], table[at + 1u], table[at + 2u], at + 4u, table[at + 3u]);
}

// Words of an edge: both ends as places in the patch's list of vertices, and its two numbers.
const EDGE: u32 = 3u;

fn edge_at(k: u32) -> Edge {
    let ends = table[k];
    return Edge(ends & 0xffffu, ends >> 16u, bitcast<f32>(table[k + 1u]), bitcast<f32>(table[k + 2u]));
}
