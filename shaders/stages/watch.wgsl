// What a step found, until somebody looks. Mirrors src/gpu/watch.rs.

// The allowed kinetic energy in integers, so that the order of adding up changes nothing.
const ALL_ENERGY: u32 = 0x1000000u;
// A step looks at one part of so many of the edges, the next at the next, but no fewer than these.
const TURNS: u32 = 128u;
const LEAST: u32 = 64u;
// Said beside an edge's place by `single_workgroup.wgsl`, where it is one in the tile's table.
const IN_TABLE: u32 = 0x80000000u;

struct Found {
    // The first vertex out of bounds, the first edge of those looked at that is too long, the first vertex faster than the bound; none.
    lost: atomic<u32>,
    long: atomic<u32>,
    fast: atomic<u32>,
    // Energy so far, and whether it came to more than is allowed.
    energy: atomic<u32>,
    hot: atomic<u32>,
    // 1 since a step failed: later ones, which start where it did, add nothing.
    stopped: u32,
    // Good steps, and where the next begins among the edges.
    steps: u32,
    next: u32,
}

fn has_failed() -> bool {
    return atomicLoad(&found.lost) != NONE || atomicLoad(&found.long) != NONE || atomicLoad(&found.hot) != 0u;
}

fn look_at_vertex(i: u32, x: vec3f, p: vec3f, share: f32) {
    if !(is_bounded(x) && is_bounded(p)) {
        atomicMin(&found.lost, i);
    }
    let ratio = p * params.per_length;
    if share > 0.0 && dot(ratio, ratio) > 1.0 {
        atomicMin(&found.fast, i);
    }
}

fn add_energy(share: f32) {
    let units = u32(min(share, 1.0) * f32(ALL_ENERGY) + 0.5);
    let before = atomicAdd(&found.energy, units);
    // No more than one whole is added at once, so one of those who add sees it pass.
    if before < ALL_ENERGY && before + units >= ALL_ENERGY {
        atomicStore(&found.hot, 1u);
    }
}

// By one invocation, once all have looked: of `parts` things that are looked at in turn, `each` are in a step.
fn end_of_watch(parts: u32, each: u32) {
    if has_failed() {
        found.stopped = 1u;
        return;
    }
    found.steps += 1u;
    found.next = (found.next + each) % max(parts, 1u);
    atomicStore(&found.fast, NONE);
    atomicStore(&found.energy, 0u);
}
