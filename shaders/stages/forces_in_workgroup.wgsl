// Bending and wind of a cloth that is stepped by one workgroup. Their data is in the workgroup's table. Their
// intermediate vectors are stored behind the state, because workgroup memory has room for displacements only. The table
// of a cloth without these forces has no data for them.

// Whether the table has bending and wind, where they start in it, and the number of panels.
override BENDS: bool = false;
override BENDING: u32 = 0u;
override AIR: bool = false;
override WIND: u32 = 0u;
override PANELS: u32 = 0u;

// The table has, for bending: the number of passes in use (0 if the step has no bending), room for 16 passes, a row per
// vertex, and the slices of the rings.
const MAX_PASSES: u32 = 16u;
// Vectors that bending stores per vertex.
const BEND_VECTORS: u32 = 6u;

fn passes() -> u32 {
    return table[BENDING];
}

fn float_at(at: u32) -> f32 {
    return bitcast<f32>(table[at]);
}

fn bend_pass_at(index: u32) -> BendPass {
    let at = BENDING + 1u + 4u * index;
    return BendPass(float_at(at), float_at(at + 1u), float_at(at + 2u), table[at + 3u]);
}

fn is_filtered() -> bool {
    return passes() > 1u;
}

fn bend_rows() -> u32 {
    return BENDING + 1u + 4u * MAX_PASSES;
}

fn row_of(v: u32) -> BendRow {
    let at = bend_rows() + 3u * v;
    return BendRow(float_at(at), float_at(at + 1u), float_at(at + 2u));
}

fn ring_slices() -> u32 {
    return bend_rows() + 3u * params.vertices;
}

fn bend_room() -> u32 {
    return params.vertices;
}

// Stored behind the positions and the displacements of the levels.
fn bend_vector(at: u32) -> vec3f {
    return state[2u * params.vertices + at].xyz;
}

fn set_bend_vector(at: u32, value: vec3f) {
    state[2u * params.vertices + at] = vec4f(value, 0.0);
}

fn bent_x(v: u32) -> vec3f {
    return state[v].xyz;
}

fn bent_p(v: u32) -> vec3f {
    return displacement(v);
}

// Where a panel's force on each of its corners is stored, behind the vectors of bending. Behind the last panel is a zero,
// which pads the lists of panels around vertices.
fn blown_at(panel: u32) -> u32 {
    return (2u + select(0u, BEND_VECTORS, BENDS)) * params.vertices + panel;
}

fn panel_at(k: u32) -> Panel {
    let at = WIND + 4u * k;
    return Panel(vec3u(table[at], table[at + 1u], table[at + 2u]), float_at(at + 3u));
}

// The force of the panel named at word `at`, if that is before `end`.
fn blown_by(at: u32, end: u32) -> vec3f {
    return state[blown_at(table[select(at, end - 1u, at >= end)])].xyz * select(1.0, 0.0, at >= end);
}

fn wind_on(v: u32) -> vec3f {
    let slice = WIND + 4u * PANELS + v / SLICE;
    let end = table[slice + 1u];
    var force = vec3f();
    // Several at once, because memory takes long to answer.
    for (var at = table[slice] + v % SLICE; at < end; at += 3u * SLICE) {
        force += blown_by(at, end) + blown_by(at + SLICE, end) + blown_by(at + 2u * SLICE, end);
    }
    return force;
}

fn bends() -> bool {
    return BENDS && passes() > 0u;
}

fn blows() -> bool {
    return AIR && params.half_density > 0.0;
}

// The part of the forces that reads neighbors; displacements are still those of the last substep.
fn gather_forces(lane: u32, now: Substep) {
    if blows() {
        var next = panel_at(lane);
        for (var k = lane; k < PANELS; k += LANES) {
            let panel = next;
            // Fetched early, because memory takes long to answer.
            next = panel_at(min(k + LANES, PANELS - 1u));
            let c = panel.corners;
            let velocity = (displacement(c.x) + displacement(c.y) + displacement(c.z)) * (now.rate / 3.0);
            let force = wind_force(state[c.x].xyz, state[c.y].xyz, state[c.z].xyz, velocity, panel.mass, now);
            state[blown_at(k)] = vec4f(force / 3.0, 0.0);
        }
    }
    if bends() {
        for (var v = lane; v < params.vertices; v += LANES) {
            first_moment(v, now.rate, fetched(v));
        }
        for (var index = 1u; index < passes(); index++) {
            meet_at_state();
            for (var v = lane; v < params.vertices; v += LANES) {
                trial_displacements(v, state[v].w, bend_pass_at(index));
            }
            meet_at_state();
            for (var v = lane; v < params.vertices; v += LANES) {
                filter_moments(v, bend_pass_at(index));
            }
        }
    }
    if bends() || blows() {
        meet_at_state();
    }
}

// A predicted displacement with the contribution of the forces added.
fn pushed(v: u32, u: vec3f, now: Substep) -> vec3f {
    let kick = state[v].w * now.gain;
    var moved = u;
    if bends() {
        moved += bend_force(v, fetched(v)) * kick;
    }
    if blows() {
        moved += wind_on(v) * kick;
    }
    return moved;
}
