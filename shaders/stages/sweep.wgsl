// A Gauss-Seidel sweep over the edges of a table, color after color. The including shader defines how an edge is
// corrected (`correct`).

// The edges of `colors` colors, from word `start` of the table on. Each color has room for `width` edges: first the
// ends of all, then all inverse rest lengths, then all inverse weights.
struct ColoredEdges {
    start: u32,
    width: u32,
    colors: u32,
}

// An edge as it is stored: both ends, as positions in the tile's list of vertices, in one word, then its two numbers as
// bits. It is decoded only when it is used; decoding it on loading would stall until memory has answered.
struct StoredEdge {
    ends: u32,
    inverse_rest: u32,
    inverse_weight: u32,
}

// The first edge of an invocation in each of four colors.
struct FourColors {
    a: StoredEdge,
    b: StoredEdge,
    c: StoredEdge,
    d: StoredEdge,
}

// Edge number k of a color, for which there must be room. Colors past the last one return unspecified edges, which must not be used.
fn fetch(edges: ColoredEdges, color: u32, k: u32) -> StoredEdge {
    let at = edges.start + 3u * edges.width * color + k;
    return StoredEdge(table[at], table[at + edges.width], table[at + 2u * edges.width]);
}

fn fetch_four(edges: ColoredEdges, color: u32, lane: u32) -> FourColors {
    if lane >= edges.width {
        let nothing = StoredEdge(NONE, 0u, 0u);
        return FourColors(nothing, nothing, nothing, nothing);
    }
    return FourColors(
        fetch(edges, color, lane),
        fetch(edges, color + 1u, lane),
        fetch(edges, color + 2u, lane),
        fetch(edges, color + 3u, lane),
    );
}

fn correct_stored(stored: StoredEdge) {
    if stored.ends != NONE {
        let a = stored.ends & 0xffffu;
        correct(Edge(a, stored.ends >> 16u, bitcast<f32>(stored.inverse_rest), bitcast<f32>(stored.inverse_weight)));
    }
}

// Corrects the edges of a color: the invocation's first one, which was prefetched, and any further ones.
fn sweep_color(edges: ColoredEdges, color: u32, first: StoredEdge, lane: u32) {
    if color >= edges.colors {
        return;
    }
    correct_stored(first);
    // A loop takes time even if it ends at once, and the compiler can drop one around which the condition is known to be false.
    if edges.width > LANES {
        for (var k = lane + LANES; k < edges.width; k += LANES) {
            correct_stored(fetch(edges, color, k));
        }
    }
    workgroupBarrier();
}

fn sweep_four(edges: ColoredEdges, color: u32, four: FourColors, lane: u32) {
    sweep_color(edges, color, four.a, lane);
    sweep_color(edges, color + 1u, four.b, lane);
    sweep_color(edges, color + 2u, four.c, lane);
    sweep_color(edges, color + 3u, four.d, lane);
}

// Sweeps all colors, given the prefetched edges of the first four. Memory takes longer to answer than a color to sweep,
// so edges are fetched for four colors at a time while the four colors before are swept.
fn sweep(edges: ColoredEdges, first: FourColors, lane: u32) {
    var four = first;
    for (var color = 0u; color < edges.colors; color += 8u) {
        let next = fetch_four(edges, color + 4u, lane);
        sweep_four(edges, color, four, lane);
        four = fetch_four(edges, color + 8u, lane);
        sweep_four(edges, color + 4u, next, lane);
    }
}
