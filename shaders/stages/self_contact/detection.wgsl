// Detection lists the pairs that may come closer than their thickness within some substeps, in three kernels: `descend` finds
// leaves that meet, `compare` finds those of their features whose boxes meet, and `measure` lists those of these candidates
// that are close enough. The order of these lists has no effect on the result.

// Limit on the number of pairs. Beyond it, all cloth is in one place.
const MAX_PAIRS: u32 = 0x10000000u;
// Each unit of space has room for so many pairs of leaves, and for so many candidates.
const LEAF_PAIRS: u32 = 2u;
const CANDIDATES: u32 = 8u;

// Pairs of leaves, followed by candidates: of a vertex and a triangle from the start of the rest, of two edges from its end.
// A candidate is what `Listed` has in `row` and `other`.
@group(1) @binding(16) var<storage, read_write> scratch: array<vec2u>;

fn space() -> u32 {
    return arrayLength(&scratch) / (LEAF_PAIRS + CANDIDATES);
}

// The number that the first invocation passes, for all.
fn broadcast(value: u32, lane: u32) -> u32 {
    if lane == 0u {
        total = value;
    }
    return workgroupUniformLoad(&total);
}

// Whether detection goes on: without room, too, it counts all that it needs.
fn goes_on() -> bool {
    return contact_state.status.detects != 0u && (atomicLoad(&contact_state.status.stopped) & ~NO_ROOM) == 0u;
}

// Stops the step if there is no space for so many items, of which a unit has room for `each`.
fn demand_space(items: u32, each: u32) {
    if items > each * space() {
        atomicMax(&contact_state.status.space_needed, (items + each - 1u) / each);
        atomicOr(&contact_state.status.stopped, select(NO_ROOM, CROWDED, items > MAX_PAIRS));
    }
}

// A list of features in the table has the first of each leaf.
struct Features {
    first: u32,
    count: u32,
}

fn features_of(list: u32, leaf: u32) -> Features {
    let first = table[list + leaf];
    return Features(first, table[list + leaf + 1u] - first);
}

fn place_of_candidate(k: u32, is_edge: bool) -> u32 {
    return select(LEAF_PAIRS * space() + k, arrayLength(&scratch) - 1u - k, is_edge);
}
