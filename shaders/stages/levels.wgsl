// The coarse levels that one workgroup holds together: restricts each from the next finer one and sweeps them one after
// another, coarsest first. The theory is in src/multigrid/hierarchy.rs, the layout in src/gpu/multigrid/level_table.rs.
// The including shader defines where an aggregate's center and inverse mass (`center_of`), its predicted and its
// corrected displacement (`predicted_of`, `corrected_of`) and the members of the finest level (`below`) are stored.

// Number of levels held here. A step may use only the finest of all levels; their number is `params.levels`.
override LEVELS: u32 = 1u;
// Number of finer levels, which are swept elsewhere.
override FINER: u32 = 0u;
// Number of aggregates of the finest level held here.
override FINEST: u32 = 64u;
// Number of aggregates of all levels held here.
override AGGREGATES: u32 = 64u;
// Largest number of members of an aggregate of the finest level; 0 if that level is restricted elsewhere.
override OF_FINEST: u32 = 0u;
// Largest number of members of an aggregate of the other levels.
override MEMBERS: u32 = 4u;
// Edges per color that there is room for.
override COARSE_WIDTH: u32 = 64u;
// Number of colors of all levels. Those of each level begin at a multiple of four.
override COARSE_COLORS: u32 = 4u;
// Where the levels begin in the table. It holds: for each level the index of its first aggregate, and the total; for
// each level its first color, and the total; for each level its number of sweeps; for each aggregate its aggregate in
// the next coarser level; for each level the first members of its aggregates, then their mass shares, then the second
// members and so on, padded by the first member with share 0; the edges. Aggregates are identified by their index in
// this order.
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

// How often the edges of a level are swept.
fn sweeps_of(level: u32) -> u32 {
    return select(1u, table[COARSE + 2u * (LEVELS + 1u) + level], params.coarse_rule == PROJECT_COARSE);
}

fn labels() -> u32 {
    return COARSE + 3u * LEVELS + 2u;
}

fn label_of(k: u32) -> u32 {
    return table[labels() + k];
}

// Number of levels in use.
fn levels_in_use() -> u32 {
    return max(params.levels, FINER + 1u) - FINER;
}

// The first color of the coarsest level in use.
fn first_in_use() -> u32 {
    return first_color(levels_in_use() - 1u);
}

fn lists() -> u32 {
    return labels() + AGGREGATES;
}

fn coarse_edges() -> ColoredEdges {
    return ColoredEdges(lists() + 2u * OF_FINEST * FINEST + 2u * MEMBERS * (AGGREGATES - FINEST), COARSE_WIDTH, COARSE_COLORS);
}

// The edges of the levels in use, from color number `first_in_use` on.
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

// A member of an aggregate, and its share of the mass.
struct Share {
    item: u32,
    share: f32,
}

// Number `m` of the members of an aggregate whose first one is at word `at` of the table, in a level of `count` aggregates.
// Those past the last one have no effect.
fn fetch_member(at: u32, count: u32, m: u32, members: u32) -> Share {
    let word = at + 2u * count * min(m, members - 1u);
    return Share(table[word], select(bitcast<f32>(table[word + count]), 0.0, m >= members));
}

// Adds a member's part of the average, relative to `origin`.
fn add_member(sum: ptr<function, Item>, level: u32, origin: vec3f, member: Share) {
    let item = item_of(level, member.item);
    (*sum).x += (item.x - origin) * member.share;
    (*sum).u += item.u * member.share;
}

// Restricts to a level from the next finer one. Its aggregates have `members` members each, listed from a word of the
// table on. Four members are fetched at a time, because memory takes long to answer.
fn restrict_level(level: u32, list: u32, members: u32, lane: u32) {
    let start = start_of(level);
    let end = start_of(level + 1u);
    let count = end - start;
    for (var k = start + lane; k < end; k += LANES) {
        let at = list + k - start;
        let origin = item_of(level, table[at]).x;
        var sum = Item();
        for (var m = 0u; m < members; m += 4u) {
            let a = fetch_member(at, count, m, members);
            let b = fetch_member(at, count, m + 1u, members);
            let c = fetch_member(at, count, m + 2u, members);
            let d = fetch_member(at, count, m + 3u, members);
            add_member(&sum, level, origin, a);
            add_member(&sum, level, origin, b);
            add_member(&sum, level, origin, c);
            add_member(&sum, level, origin, d);
        }
        set_center(k, origin + sum.x);
        set_predicted(k, sum.u);
        set_corrected(k, sum.u);
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

// Sweeps all levels in use, given the edges of the first four colors, and leaves the corrected displacements of the
// finest level. `skipped` is `first_in_use()`.
fn sweep_levels(skipped: u32, first: FourColors, lane: u32) {
    let edges = edges_in_use(skipped);
    // As in `sweep`.
    var four = first;
    var end = 0u;
    for (var above = levels_in_use(); above > 0u; above--) {
        let level = above - 1u;
        if above < levels_in_use() {
            prolongate(level, lane);
        }
        let start = end;
        end = edges.colors;
        if level > 0u {
            end = first_color(level - 1u) - skipped;
        }
        for (var left = sweeps_of(level); left > 0u; left--) {
            for (var color = start; color < end; color += 4u) {
                let goes_back = color + 4u == end && left > 1u;
                let next = fetch_four(edges, select(color + 4u, start, goes_back), lane);
                sweep_four(edges, color, four, lane);
                four = next;
            }
        }
    }
}

// Prolongates the corrections of the next coarser level to a level.
fn prolongate(level: u32, lane: u32) {
    let start = start_of(level);
    let end = start_of(level + 1u);
    // Loaded early, to be there when it is needed.
    var above = label_of(start + lane);
    // The displacements of the coarser level are not needed any more; replace them by its corrections.
    for (var k = end + lane; k < start_of(level + 2u); k += LANES) {
        set_corrected(k, corrected_of(k) - predicted_of(k));
    }
    workgroupBarrier();
    for (var k = start + lane; k < end; k += LANES) {
        set_corrected(k, corrected_of(k) + corrected_of(above));
        above = label_of(k + LANES);
    }
    workgroupBarrier();
}

fn correct_coarse(edge: Edge) {
    let x_a = center_of(edge.a);
    let x_b = center_of(edge.b);
    let u_a = corrected_of(edge.a);
    let u_b = corrected_of(edge.b);
    let predicted = predicted_of(edge.a) - predicted_of(edge.b);
    let impulse = coarse_impulse(x_a.xyz - x_b.xyz, u_a - u_b, predicted, x_a.w + x_b.w, edge);
    set_corrected(edge.a, u_a + impulse * x_a.w);
    set_corrected(edge.b, u_b - impulse * x_b.w);
}
