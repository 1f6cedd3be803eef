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

// An edge as it is stored: both ends, as places in the patch's list of vertices, in one word; then its two numbers.
// Not looked into when it is fetched, for that would be to wait for it.
struct Stored {
    ends: u32,
    inverse_rest: u32,
    inverse_weight: u32,
}

const NO_EDGE: u32 = 0xffffffffu;

// The edge number k of a colour; what is past the last colour must not be used.
fn fetch(patch_index: u32, color: u32, k: u32) -> Stored {
    let at = PATCHES * (1u + 2u * ROOM) + 3u * WIDTH * (patch_index * COLORS + color) + k;
    return Stored(table[at], table[at + WIDTH], table[at + 2u * WIDTH]);
}

fn is_edge(stored: Stored, k: u32) -> bool {
    return k < WIDTH && stored.ends != NO_EDGE;
}

fn edge_of(stored: Stored) -> Edge {
    let a = stored.ends & 0xffffu;
    return Edge(a, stored.ends >> 16u, bitcast<f32>(stored.inverse_rest), bitcast<f32>(stored.inverse_weight));
}

// A colour's edges: the lane's first, and those that it has beside. What becomes of one, `correct`, is each shader's own.
fn sweep(index: u32, color: u32, first: Stored, lane: u32) {
    if is_edge(first, lane) {
        correct(edge_of(first));
    }
    for (var k = lane + LANES; k < WIDTH; k += LANES) {
        let more = fetch(index, color, k);
        if is_edge(more, k) {
            correct(edge_of(more));
        }
    }
}
