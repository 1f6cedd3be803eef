// Coarse levels that one workgroup holds together: averaged, each from the one below, and swept one after another, the
// coarsest first. What they are says src/multigrid/hierarchy.rs, how they are laid out src/gpu/multigrid/level_table.rs.
// A shader says where an aggregate's center with its inverse mass (`center_of`) and its displacements, as predicted and as
// corrected (`predicted_of`, `corrected_of`), are kept, and those of what the finest is made of (`below`).

// Levels, finer ones that are swept elsewhere, aggregates of the finest and of all of them, most members of one of the finest, 0 if that
// is averaged elsewhere, and of another, and edges of a color and colors that there is room for. Levels begin at colors that are
// multiples of four. A step may use the finest of them alone: `params.levels`, of all.
override LEVELS: u32 = 1u;
override FINER: u32 = 0u;
override FINEST: u32 = 64u;
override AGGREGATES: u32 = 64u;
override OF_FINEST: u32 = 0u;
override MEMBERS: u32 = 4u;
override COARSE_WIDTH: u32 = 64u;
override COARSE_COLORS: u32 = 4u;
// Where in the table they are: for each level where its aggregates start, and the end; for each level its first color, and
// the end; for each aggregate the one that it is in; for each its members, each with its share, the first again with none
// where there are fewer; edges. What is an aggregate is its place here.
override COARSE: u32 = 0u;

struct Item {
    x: vec3f,
    u: vec3f,
}

fn start_of(level: u32) -> u32 {
    return table[COARSE + level];
}

fn first_color(level: u32) -> u32 {
    return table[COARSE + LEVELS + 1u + level];
}

fn label_of(k: u32) -> u32 {
    return table[COARSE + 2u * (LEVELS + 1u) + k];
}

// Levels in use, and where the colors of the coarsest of them start.
fn levels_in_use() -> u32 {
    return max(params.levels, FINER + 1u) - FINER;
}

fn first_in_use() -> u32 {
    return first_color(levels_in_use() - 1u);
}

fn lists() -> u32 {
    return COARSE + 2u * (LEVELS + 1u) + AGGREGATES;
}

fn coarse_edges() -> ColoredEdges {
    return ColoredEdges(lists() + 2u * OF_FINEST * FINEST + 2u * MEMBERS * (AGGREGATES - FINEST), COARSE_WIDTH, COARSE_COLORS);
}

// Those of the levels in use, the first color being number `first_in_use`.
fn edges_in_use(skipped: u32) -> ColoredEdges {
    let all = coarse_edges();
    return ColoredEdges(all.start + 3u * all.width * skipped, all.width, all.colors - skipped);
}

fn item_of(level: u32, k: u32) -> Item {
    if OF_FINEST > 0u && level == 0u {
        return below(k);
    }
    return Item(center_of(k).xyz, corrected_of(k));
}

// A level from the one below it: its aggregates have so many members each, listed from a word on.
fn restrict_level(level: u32, list: u32, members: u32, lane: u32) {
    let start = start_of(level);
    let end = start_of(level + 1u);
    for (var k = start + lane; k < end; k += LANES) {
        let listed = list + 2u * members * (k - start);
        let origin = item_of(level, table[listed]).x;
        var dx = vec3f();
        var u = vec3f();
        for (var m = 0u; m < members; m++) {
            let item = item_of(level, table[listed + 2u * m]);
            let share = bitcast<f32>(table[listed + 2u * m + 1u]);
            dx += (item.x - origin) * share;
            u += item.u * share;
        }
        set_center(k, origin + dx);
        set_predicted(k, u);
        set_corrected(k, u);
    }
    workgroupBarrier();
}

fn restrict_levels(lane: u32) {
    if OF_FINEST > 0u {
        restrict_level(0u, lists(), OF_FINEST, lane);
    }
    for (var level = 1u; level < levels_in_use(); level++) {
        let offset = 2u * OF_FINEST * FINEST + 2u * MEMBERS * (start_of(level) - FINEST);
        restrict_level(level, lists() + offset, MEMBERS, lane);
    }
}

// Colors of levels that are not in use, the level that is swept, and the color in use from which on it is the next finer one.
var<private> skipped: u32;
var<private> level: u32;
var<private> next_at: u32;

fn go_to(to: u32) {
    level = to;
    next_at = NO_EDGE;
    if to > 0u {
        next_at = first_color(to - 1u) - skipped;
    }
}

// Sweeps all in use, the first edges being there, and leaves what each of the finest is moved by.
fn sweep_levels(first: FourColors, lane: u32) {
    go_to(levels_in_use() - 1u);
    sweep(edges_in_use(skipped), first, lane);
    descend(COARSE_COLORS, lane);
}

// Hands down what levels were corrected by, as far as the one that is swept from a color on.
fn descend(color: u32, lane: u32) {
    while color >= next_at {
        let finer = start_of(level - 1u);
        let here = start_of(level);
        let end = start_of(level + 1u);
        // Asked for now, to be there when it is looked into.
        var above = label_of(finer + lane);
        // The level above is not needed any more: from here on it holds what it was corrected by.
        for (var k = here + lane; k < end; k += LANES) {
            set_corrected(k, corrected_of(k) - predicted_of(k));
        }
        workgroupBarrier();
        for (var k = finer + lane; k < here; k += LANES) {
            set_corrected(k, corrected_of(k) + corrected_of(above));
            above = label_of(k + LANES);
        }
        workgroupBarrier();
        go_to(level - 1u);
    }
}

fn correct_coarse(edge: Edge) {
    let x_a = center_of(edge.a);
    let x_b = center_of(edge.b);
    let u_a = corrected_of(edge.a);
    let u_b = corrected_of(edge.b);
    let impulse = coarse_impulse(x_a.xyz - x_b.xyz, u_a - u_b, edge, params.holds != 0u);
    set_corrected(edge.a, u_a + impulse * x_a.w);
    set_corrected(edge.b, u_b - impulse * x_b.w);
}
