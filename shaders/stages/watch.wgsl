// What the watch has found in the steps since it was last read. Mirrors src/gpu/watch.rs.

// The allowed kinetic energy as a fixed-point number. Integer sums do not depend on the order of summation.
const ALL_ENERGY: u32 = 0x1000000u;
// Each step checks one of so many parts of the edges, in turn.
const TURNS: u32 = 128u;
// The least number of edges that a step checks.
const FEWEST_CHECKED: u32 = 16u;
// Set beside the index of an edge that is an index in the table of a single workgroup, or of tiles.
const IN_TABLE: u32 = 0x80000000u;
const IN_TILES: u32 = 0x40000000u;

struct Defects {
    // The first vertex out of bounds; NONE if there is none.
    lost: atomic<u32>,
    // The first of the checked edges that is too long; NONE if there is none.
    long: atomic<u32>,
    // The first vertex faster than the bound on the RMS speed; NONE if there is none.
    fast: atomic<u32>,
    // Kinetic energy of the vertices faster than that, as a share of ALL_ENERGY.
    energy: atomic<u32>,
    // 1 once that energy has exceeded what is allowed.
    hot: atomic<u32>,
    // 1 after a step failed. Later steps start from the same state and do not check anything.
    stopped: u32,
    // Number of successful steps.
    steps: u32,
}

fn has_failed() -> bool {
    return atomicLoad(&found.lost) != NONE || atomicLoad(&found.long) != NONE || atomicLoad(&found.hot) != 0u;
}

// Vertex `i` with inverse mass `w`, now at `x`, which moved by `p` in the last substep. Few are ever fast, so the sum costs
// nothing else.
fn check_vertex(i: u32, x: vec3f, p: vec3f, w: f32) {
    if !(is_bounded(x) && is_bounded(p)) {
        atomicMin(&found.lost, i);
    }
    if w > 0.0 && is_fast(p) {
        atomicMin(&found.fast, i);
        add_energy(energy_share(p, 1.0 / w));
    }
}

fn add_energy(share: f32) {
    let units = u32(min(share, 1.0) * f32(ALL_ENERGY) + 0.5);
    let before = atomicAdd(&found.energy, units);
    // A single addition is at most the whole, so one of the invocations sees the sum pass it; others, too, once it wraps around.
    if before < ALL_ENERGY && before + units >= ALL_ENERGY {
        atomicStore(&found.hot, 1u);
    }
}

// Called by one invocation at the end of the check.
fn end_of_watch() {
    if has_failed() {
        found.stopped = 1u;
        return;
    }
    found.steps += 1u;
    atomicStore(&found.fast, NONE);
    atomicStore(&found.energy, 0u);
}
