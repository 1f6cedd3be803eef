// Detection lists the pairs that may come closer than their thickness within some substeps, in a row for each first
// feature. A row is divided into parts, which look at leaves in ascending order and are processed at once. A first pass
// counts the pairs of each part. If there is room for all of them, a second pass finds them again and writes them. Thus
// no pair is dropped, and the result does not depend on the order of invocations.

override LANES: u32 = 256u;

// Limits on the pairs of a part, and on all pairs. Beyond these, all cloth is in one place.
const MOST_OF_ROW: u32 = 4096u;
const MOST_OF_ALL: u32 = 0x10000000u;

var<workgroup> counts: array<u32, WORKGROUP>;
var<workgroup> all_counts: array<u32, LANES>;

// The midpoint of a vertex's path, with the distance that it may stray in w, and its displacement.
struct Place {
    middle: vec4f,
    u: vec3f,
}

fn place_at(v: u32) -> Place {
    return Place(vertices[v].middle, vertices[v].u.xyz);
}

fn box_of(a: Place, b: Place) -> Box {
    return Box(
        min(a.middle.xyz - a.middle.w, b.middle.xyz - b.middle.w),
        max(a.middle.xyz + a.middle.w, b.middle.xyz + b.middle.w),
        min(a.u, b.u),
        max(a.u, b.u),
    );
}

fn box_with(a: Box, b: Place) -> Box {
    return Box(
        min(a.low, b.middle.xyz - b.middle.w),
        max(a.high, b.middle.xyz + b.middle.w),
        min(a.step_low, b.u),
        max(a.step_high, b.u),
    );
}

fn is_let_go(row: u32, other: u32) -> bool {
    let is_edge = row >= about.first_edge;
    let key = vec2u(select(row, row - about.first_edge, is_edge), other);
    let first = select(0u, about.let_go, is_edge);
    for (var k = first; k < first + select(about.let_go, about.let_go_of_edges, is_edge); k++) {
        if all(let_go[k] == key) {
            return true;
        }
    }
    return false;
}

fn closest(is_edge: bool, at: Four) -> vec4f {
    if is_edge {
        return edge_edge(at);
    }
    return vertex_triangle(at);
}

// The distance at which a pair is held, or 0 if it cannot come so close within the substeps that detection covers.
fn thickness_of(is_edge: bool, corners: vec4u, a: Place, b: Place, c: Place, d: Place) -> f32 {
    let y = Four(a.middle.xyz, b.middle.xyz, c.middle.xyz, d.middle.xyz);
    let apart = length(between(closest(is_edge, y), y));
    var relative = max(square(a.u - c.u), square(a.u - d.u));
    var stray: f32;
    if is_edge {
        relative = max(relative, max(square(b.u - c.u), square(b.u - d.u)));
        stray = max(a.middle.w, b.middle.w) + max(c.middle.w, d.middle.w);
    } else {
        relative = max(relative, square(a.u - b.u));
        stray = a.middle.w + max(b.middle.w, max(c.middle.w, d.middle.w));
    }
    // A lower bound on the distance.
    let left = apart - stray - sqrt(relative) * (0.5 * known.status.ahead);
    if !(left < about.thickness) {
        return 0.0;
    }
    var thickness = about.thickness;
    if piece_of(corners.x) == piece_of(corners.w) {
        let rest = Four(rest_of(corners.x), rest_of(corners.y), rest_of(corners.z), rest_of(corners.w));
        thickness = min(thickness, 0.5 * length(between(closest(is_edge, rest), rest)));
    }
    return select(0.0, thickness, left < thickness);
}

// The multipliers of a pair in the previous lists, whose rows are sorted.
fn held_before(row: u32, other: u32) -> vec4f {
    let before = 1u - known.status.half;
    let first = before * (about.rows + 1u) + row;
    let list = before * about.room;
    let end = starts[first + 1u];
    var low = starts[first];
    var high = end;
    while low < high {
        let middle = (low + high) / 2u;
        if pairs[list + middle].other < other {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    if low < end && pairs[list + low].other == other {
        return pairs[list + low].lambda;
    }
    return vec4f();
}

// Counts the pairs of a part of a row, or, if it `writes`, writes them from `first` on.
fn look_at_part(part: u32, writes: bool, first: u32) -> u32 {
    let row = part / about.parts;
    let turn = part % about.parts;
    let is_edge = row >= about.first_edge;
    let leaf = table[about.of_leaves + row];
    if leaf == NONE {
        return 0u;
    }
    var ends = vec2u(row);
    if is_edge {
        ends = edge(row - about.first_edge);
    }
    let a = place_at(ends.x);
    let e = place_at(ends.y);
    let here = box_of(a, e);
    // A pair of edges belongs to the row of the edge with the lower index.
    let skipped = select(0u, beside[list_of(leaf) + 1u], is_edge);
    let count = beside[list_of(leaf)] - skipped;
    let list = list_of(leaf) + 2u + skipped;
    // The starts of the leaves' edges follow those of their triangles.
    let of_leaves = about.leaves + select(0u, (1u << about.depth) + 1u, is_edge);
    var found = 0u;
    for (var k = count * turn / about.parts; k < count * (turn + 1u) / about.parts; k++) {
        let other_leaf = beside[list + k];
        if are_apart(here, box_of_node((1u << about.depth) + other_leaf)) {
            continue;
        }
        var item = table[of_leaves + other_leaf];
        let end = table[of_leaves + other_leaf + 1u];
        if is_edge {
            item = max(item, row - about.first_edge + 1u);
        }
        for (; item < end; item++) {
            var corners: vec4u;
            var b = e;
            if is_edge {
                corners = vec4u(ends, edge(item));
                if any(corners.xy == corners.zw) || any(corners.xy == corners.wz) {
                    continue;
                }
            } else {
                corners = vec4u(row, triangle(item));
                if any(corners.yzw == vec3u(row)) {
                    continue;
                }
                b = place_at(corners.y);
            }
            let c = place_at(corners.z);
            let d = place_at(corners.w);
            var there = box_of(c, d);
            if !is_edge {
                there = box_with(there, b);
            }
            if are_apart(here, there) {
                continue;
            }
            let thickness = thickness_of(is_edge, corners, a, b, c, d);
            if thickness <= 0.0 || is_let_go(row, item) {
                continue;
            }
            if writes {
                let place = known.status.half * about.room + first + found;
                pairs[place] = Listed(corners, held_before(row, item), item, thickness);
            }
            found++;
        }
        if found > MOST_OF_ROW {
            atomicOr(&known.status.stopped, CROWDED);
            return found;
        }
    }
    return found;
}

// `starts` contains the starts of the rows in each half of the lists. After these it has the start of each part in its
// workgroup, then a number for each workgroup: a count of pairs at first, then a start.
fn place_of_part(part: u32) -> u32 {
    return 2u * (about.rows + 1u) + part;
}

fn place_of_group(group: u32) -> u32 {
    return place_of_part(about.parts * about.rows) + group;
}

fn start_of_part(part: u32) -> u32 {
    return starts[place_of_part(part)] + starts[place_of_group(part / WORKGROUP)];
}

@compute @workgroup_size(WORKGROUP)
fn count(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if !looks_here(lane) {
        return;
    }
    let part = item(id, groups);
    let is_part = part < about.parts * about.rows;
    var found = 0u;
    if is_part {
        found = look_at_part(part, false, 0u);
    }
    counts[lane] = found;
    for (var by = 1u; by < WORKGROUP; by *= 2u) {
        workgroupBarrier();
        var before = 0u;
        if lane >= by {
            before = counts[lane - by];
        }
        workgroupBarrier();
        counts[lane] += before;
    }
    if is_part {
        starts[place_of_part(part)] = counts[lane] - found;
    }
    if lane == WORKGROUP - 1u && part - lane < about.parts * about.rows {
        starts[place_of_group(part / WORKGROUP)] = counts[lane];
    }
}

// One workgroup computes where the parts of each workgroup start, and checks whether there is room for all pairs.
@compute @workgroup_size(LANES)
fn scan(@builtin(local_invocation_index) lane: u32) {
    if !looks_here(lane) {
        return;
    }
    let groups = (about.parts * about.rows + WORKGROUP - 1u) / WORKGROUP;
    let each = (groups + LANES - 1u) / LANES;
    let first = min(lane * each, groups);
    let end = min(first + each, groups);
    var sum = 0u;
    for (var k = first; k < end; k++) {
        sum = min(sum + starts[place_of_group(k)], MOST_OF_ALL);
    }
    all_counts[lane] = sum;
    for (var by = 1u; by < LANES; by *= 2u) {
        workgroupBarrier();
        var before = 0u;
        if lane >= by {
            before = all_counts[lane - by];
        }
        workgroupBarrier();
        all_counts[lane] = min(all_counts[lane] + before, MOST_OF_ALL);
    }
    var total = all_counts[lane] - sum;
    for (var k = first; k < end; k++) {
        let here = starts[place_of_group(k)];
        starts[place_of_group(k)] = total;
        if k == about.parts * (about.first_edge / WORKGROUP) {
            known.status.with_vertices = total;
        }
        total += here;
    }
    workgroupBarrier();
    if lane == LANES - 1u {
        let total = all_counts[lane];
        if total >= MOST_OF_ALL {
            atomicOr(&known.status.stopped, CROWDED);
        } else if total > about.room {
            atomicMax(&known.status.needed, total);
            atomicOr(&known.status.stopped, NO_ROOM);
        }
        known.status.half = 1u - known.status.half;
        known.status.listed = total;
        starts[known.status.half * (about.rows + 1u) + about.rows] = total;
    }
}

@compute @workgroup_size(WORKGROUP)
fn fill(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let part = item(id, groups);
    let all = about.parts * about.rows;
    if part >= all || !is_due() {
        return;
    }
    let first = start_of_part(part);
    if part % about.parts == 0u {
        starts[known.status.half * (about.rows + 1u) + part / about.parts] = first;
    }
    var end = known.status.listed;
    if part + 1u < all {
        end = start_of_part(part + 1u);
    }
    if first < end {
        look_at_part(part, true, first);
    }
}
