// Bending and wind of a cloth that one workgroup steps: what they need is in its table, and what they keep behind the state, for workgroup
// memory has room for displacements alone. A cloth that has neither has neither in its table.

// Whether the table has bending and wind, where in it they start, and how many panels there are.
override BENDS: bool = false;
override BENDING: u32 = 0u;
override BLOWS: bool = false;
override WIND: u32 = 0u;
override PANELS: u32 = 0u;

// Of bending: how many passes there are, none if this step has no bending, and 16 of them; a row for each vertex; rings.
const MOST_PASSES: u32 = 16u;
// Vectors that bending keeps for a vertex.
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
    return BENDING + 1u + 4u * MOST_PASSES;
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

// Behind positions and the displacements of levels.
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

// The third of a panel's force that each of its corners takes, behind what bending keeps. One more is there, of no panel, and 0.
fn blown_at(panel: u32) -> u32 {
    return (2u + select(0u, BEND_VECTORS, BENDS)) * params.vertices + panel;
}

fn panel_at(k: u32) -> Panel {
    let at = WIND + 4u * k;
    return Panel(vec3u(table[at], table[at + 1u], table[at + 2u]), float_at(at + 3u));
}

fn wind_on(v: u32) -> vec3f {
    let slice = WIND + 4u * PANELS + v / SLICE;
    let end = table[slice + 1u];
    var force = vec3f();
    for (var at = table[slice] + v % SLICE; at < end; at += SLICE) {
        force += state[blown_at(table[at])].xyz;
    }
    return force;
}

fn bends() -> bool {
    return BENDS && passes() > 0u;
}

fn blows() -> bool {
    return BLOWS && params.half_density > 0.0;
}

// What looks at neighbors, while displacements are still the last substep's.
fn gather_forces(lane: u32, now: Substep) {
    if blows() {
        for (var k = lane; k < PANELS; k += LANES) {
            let panel = panel_at(k);
            let c = panel.corners;
            let velocity = (displacement(c.x) + displacement(c.y) + displacement(c.z)) * (now.rate / 3.0);
            let force = wind_force(state[c.x].xyz, state[c.y].xyz, state[c.z].xyz, velocity, panel.mass, now);
            state[blown_at(k)] = vec4f(force / 3.0, 0.0);
        }
    }
    if bends() {
        for (var v = lane; v < params.vertices; v += LANES) {
            first_moment(v, now.rate);
        }
        for (var index = 1u; index < passes(); index++) {
            meet_at_state();
            for (var v = lane; v < params.vertices; v += LANES) {
                give_way(v, state[v].w, bend_pass_at(index));
            }
            meet_at_state();
            for (var v = lane; v < params.vertices; v += LANES) {
                bend_again(v, bend_pass_at(index));
            }
        }
    }
    if bends() || blows() {
        meet_at_state();
    }
}

// A displacement as predicted, and what the forces add to it.
fn pushed(v: u32, u: vec3f, now: Substep) -> vec3f {
    let kick = state[v].w * now.gain;
    var moved = u;
    if bends() {
        moved += bend_force(v) * kick;
    }
    if blows() {
        moved += wind_on(v) * kick;
    }
    return moved;
}
