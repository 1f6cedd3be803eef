// Coarse levels that one workgroup holds together: all but the finest are averaged from the one below, and swept one after
// another, the coarsest first. See src/levels.rs. A shader says where an aggregate's centre with its inverse mass (`center`)
// and its displacements, as predicted and as corrected (`predicted_of`, `coarse_by`), are kept.

// Levels, aggregates of the finest and of all of them, most members of one that is not of the finest, and edges of a colour
// and colours that there is room for. Levels begin at colours that are multiples of four.
override LEVELS: u32 = 1u;
override FINEST: u32 = 64u;
override AGGREGATES: u32 = 64u;
override MEMBERS: u32 = 4u;
override COARSE_WIDTH: u32 = 64u;
override COARSE_COLORS: u32 = 4u;
// Where in the table they are: for each level where its aggregates start, and the end; for each level its first colour, and
// the end; for each aggregate the one that it is in; for each not of the finest level its members, each with its share, the
// first again with none where there are fewer; edges. What is an aggregate is its place here.
override COARSE: u32 = 0u;

fn start_of(level: u32) -> u32 {
    return table[COARSE + level];
}

fn first_color(level: u32) -> u32 {
    return table[COARSE + LEVELS + 1u + level];
}

fn label_of(k: u32) -> u32 {
    return table[COARSE + 2u * (LEVELS + 1u) + k];
}

fn members_of(k: u32) -> u32 {
    return COARSE + 2u * (LEVELS + 1u) + AGGREGATES + 2u * MEMBERS * (k - FINEST);
}

fn coarse_edges() -> Runs {
    return Runs(members_of(AGGREGATES), COARSE_WIDTH, COARSE_COLORS);
}

// Every level from the one below it, the finest being there.
fn restrict_levels(lane: u32) {
    for (var level = 1u; level < LEVELS; level++) {
        let end = start_of(level + 1u);
        for (var k = start_of(level) + lane; k < end; k += LANES) {
            let members = members_of(k);
            let origin = center(table[members]).xyz;
            var dx = vec3f();
            var u = vec3f();
            for (var m = 0u; m < MEMBERS; m++) {
                let item = table[members + 2u * m];
                let share = bitcast<f32>(table[members + 2u * m + 1u]);
                dx += (center(item).xyz - origin) * share;
                u += coarse_by(item) * share;
            }
            set_center(k, origin + dx);
            set_predicted(k, u);
            set_coarse_by(k, u);
        }
        meet();
    }
}

// The level whose turn it is, and the colour at which it is the next finer one's.
var<private> level: u32;
var<private> turn: u32;

fn go_to(to: u32) {
    level = to;
    turn = NO_EDGE;
    if to > 0u {
        turn = first_color(to - 1u);
    }
}

// Sweeps them all, the first edges being there, and leaves what each of the finest is moved by.
fn sweep_levels(first: Four, lane: u32) {
    go_to(max(LEVELS, 1u) - 1u);
    sweep(coarse_edges(), first, lane);
    descend(COARSE_COLORS, lane);
}

// Hands down what levels were corrected by, as far as the one whose turn it is at a colour.
fn descend(color: u32, lane: u32) {
    while color >= turn {
        let finer = start_of(level - 1u);
        let here = start_of(level);
        let end = start_of(level + 1u);
        // Asked for now, to be there when it is looked into.
        var above = label_of(finer + lane);
        // The level above is not needed any more: from here on it holds what it was corrected by.
        for (var k = here + lane; k < end; k += LANES) {
            set_coarse_by(k, coarse_by(k) - predicted_of(k));
        }
        meet();
        for (var k = finer + lane; k < here; k += LANES) {
            set_coarse_by(k, coarse_by(k) + coarse_by(above));
            above = label_of(k + LANES);
        }
        meet();
        go_to(level - 1u);
    }
}

fn correct_coarse(edge: Edge) {
    let x_a = center(edge.a);
    let x_b = center(edge.b);
    let u_a = coarse_by(edge.a);
    let u_b = coarse_by(edge.b);
    let impulse = project_coarse(x_a.xyz - x_b.xyz, u_a - u_b, edge);
    set_coarse_by(edge.a, u_a + impulse * x_a.w);
    set_coarse_by(edge.b, u_b - impulse * x_b.w);
}
