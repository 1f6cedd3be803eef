// A sweep over the edges of a table, colour after colour. A shader says what becomes of an edge (`correct`), what is to be
// done before some colours (`before`), and how its lanes wait for each other (`meet`).

// Edges of so many colours from a word of the table on, each colour with room for `width` of them: all ends, then all of
// either number.
struct Runs {
    start: u32,
    width: u32,
    colors: u32,
}

// An edge as it is stored: both ends, as places in the patch's list of vertices, in one word; then its two numbers.
// Not looked into when it is fetched, for that would be to wait for it.
struct Stored {
    ends: u32,
    inverse_rest: u32,
    inverse_weight: u32,
}

// A lane's first edges of four colours.
struct Four {
    a: Stored,
    b: Stored,
    c: Stored,
    d: Stored,
}

const NO_EDGE: u32 = 0xffffffffu;

// The edge number k of a colour; what is past the last colour must not be used.
fn fetch(runs: Runs, color: u32, k: u32) -> Stored {
    if k >= runs.width {
        return Stored(NO_EDGE, 0u, 0u);
    }
    let at = runs.start + 3u * runs.width * color + k;
    return Stored(table[at], table[at + runs.width], table[at + 2u * runs.width]);
}

fn fetch_four(runs: Runs, color: u32, lane: u32) -> Four {
    return Four(
        fetch(runs, color, lane),
        fetch(runs, color + 1u, lane),
        fetch(runs, color + 2u, lane),
        fetch(runs, color + 3u, lane),
    );
}

fn take(stored: Stored) {
    if stored.ends != NO_EDGE {
        let a = stored.ends & 0xffffu;
        correct(Edge(a, stored.ends >> 16u, bitcast<f32>(stored.inverse_rest), bitcast<f32>(stored.inverse_weight)));
    }
}

// A colour's edges: the lane's first, and those that it has beside.
fn sweep_color(runs: Runs, color: u32, first: Stored, lane: u32) {
    if color >= runs.colors {
        return;
    }
    take(first);
    for (var k = lane + LANES; k < runs.width; k += LANES) {
        take(fetch(runs, color, k));
    }
    meet();
}

fn sweep_four(runs: Runs, color: u32, four: Four, lane: u32) {
    before(color, lane);
    sweep_color(runs, color, four.a, lane);
    sweep_color(runs, color + 1u, four.b, lane);
    sweep_color(runs, color + 2u, four.c, lane);
    sweep_color(runs, color + 3u, four.d, lane);
}

// All colours, the first four of which are there. Memory takes longer to answer than a colour to sweep: so four are asked
// for together, while four are swept that were asked for before.
fn sweep(runs: Runs, first: Four, lane: u32) {
    var four = first;
    for (var color = 0u; color < runs.colors; color += 8u) {
        let next = fetch_four(runs, color + 4u, lane);
        sweep_four(runs, color, four, lane);
        four = fetch_four(runs, color + 8u, lane);
        sweep_four(runs, color + 4u, next, lane);
    }
}
