// Detection lists the pairs that may come closer than their thickness within some substeps, in a row for each first
// feature. A first pass counts the pairs of each row. If there is room for all of them, a second pass finds them again
// and writes them. Thus no pair is dropped, and the result does not depend on the order of invocations.

override LANES: u32 = 256u;

const UPRIGHT: f32 = 0.64;
const MOST_EXCESS: f32 = 0.6;
// Limits on the pairs of a row, and on all pairs. Beyond these, all cloth is in one place.
const MOST_OF_ROW: u32 = 4096u;
const MOST_OF_ALL: u32 = 0x10000000u;

var<workgroup> counts: array<u32, WORKGROUP>;
var<workgroup> all_counts: array<u32, LANES>;

// The feature of a row: its vertices (the same one twice for a vertex), the box within which it may stray, and the
// range of its displacements.
struct Feature {
    a: u32,
    b: u32,
    low: vec3f,
    high: vec3f,
    step_low: vec3f,
    step_high: vec3f,
}

fn feature_of(row: u32) -> Feature {
    var ends = vec2u(row);
    if row >= about.first_edge {
        ends = edge(row - about.first_edge);
    }
    let a = vertices[ends.x];
    let b = vertices[ends.y];
    return Feature(
        ends.x,
        ends.y,
        min(a.middle.xyz - a.middle.w, b.middle.xyz - b.middle.w),
        max(a.middle.xyz + a.middle.w, b.middle.xyz + b.middle.w),
        min(a.u.xyz, b.u.xyz),
        max(a.u.xyz, b.u.xyz),
    );
}

fn is_apart(feature: Feature, n: u32) -> bool {
    let relative = max(max(feature.step_high - nodes[n].step_low, nodes[n].step_high - feature.step_low), vec3f());
    let gap = max(feature.low - nodes[n].place_high, nodes[n].place_low - feature.high);
    return any(gap > relative * (0.5 * known.status.ahead) + about.thickness);
}

// Whether two nodes of a level, or a node and itself, certainly do not meet: `Tree::is_clear`.
fn is_clear(a: u32, b: u32) -> bool {
    let more = select(0.0, number(about.excess + b), a != b);
    if number(about.excess + a) + more >= MOST_EXCESS {
        return false;
    }
    let low = min(nodes[a].normal_low, nodes[b].normal_low);
    let high = max(nodes[a].normal_high, nodes[b].normal_high);
    let axis = low + high;
    let least = dot(min(low * axis, high * axis), vec3f(1.0));
    if !(least > 0.0 && least * least > UPRIGHT * UPRIGHT * square(axis)) {
        return false;
    }
    return a == b || is_beside(a, b);
}

fn is_beside(a: u32, b: u32) -> bool {
    for (var k = table[about.beside + a]; k < table[about.beside + a + 1u]; k++) {
        if table[k] == b {
            return true;
        }
    }
    return false;
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
fn thickness_of(is_edge: bool, corners: vec4u) -> f32 {
    let a = vertices[corners.x];
    let b = vertices[corners.y];
    let c = vertices[corners.z];
    let d = vertices[corners.w];
    let y = Four(a.middle.xyz, b.middle.xyz, c.middle.xyz, d.middle.xyz);
    let apart = length(between(closest(is_edge, y), y));
    var relative = max(square(a.u.xyz - c.u.xyz), square(a.u.xyz - d.u.xyz));
    var stray: f32;
    if is_edge {
        relative = max(relative, max(square(b.u.xyz - c.u.xyz), square(b.u.xyz - d.u.xyz)));
        stray = max(a.middle.w, b.middle.w) + max(c.middle.w, d.middle.w);
    } else {
        relative = max(relative, square(a.u.xyz - b.u.xyz));
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

// The multipliers of a pair in the previous lists.
fn held_before(row: u32, other: u32) -> vec4f {
    let before = 1u - known.status.half;
    let first = before * (about.rows + 1u);
    for (var k = starts[first + row]; k < starts[first + row + 1u]; k++) {
        if pairs[before * about.room + k].other == other {
            return pairs[before * about.room + k].lambda;
        }
    }
    return vec4f();
}

// Counts the pairs of a row, or, if it `writes`, writes them from `first` on.
fn look_at_row(row: u32, writes: bool, first: u32) -> u32 {
    let is_edge = row >= about.first_edge;
    let leaf = table[about.of_leaves + row];
    if leaf == NONE {
        return 0u;
    }
    let feature = feature_of(row);
    var found = 0u;
    var n = 1u;
    while n != 0u {
        let level = firstLeadingBit(n);
        let own = ((1u << about.depth) + leaf) >> (about.depth - level);
        // A pair of edges belongs to the row of the edge with the lower index.
        let is_passed = is_edge && n < own;
        if is_passed || is_apart(feature, n) || is_clear(own, n) {
            n = after(n);
            continue;
        }
        if level < about.depth {
            n = 2u * n;
            continue;
        }
        let other_leaf = n - (1u << about.depth);
        // The starts of the leaves' edges follow those of their triangles.
        let list = about.leaves + select(0u, (1u << about.depth) + 1u, is_edge);
        var item = table[list + other_leaf];
        if is_edge {
            item = max(item, row - about.first_edge + 1u);
        }
        for (; item < table[list + other_leaf + 1u]; item++) {
            var corners: vec4u;
            if is_edge {
                corners = vec4u(feature.a, feature.b, edge(item));
                if any(corners.xy == corners.zw) || any(corners.xy == corners.wz) {
                    continue;
                }
            } else {
                corners = vec4u(row, triangle(item));
                if any(corners.yzw == vec3u(row)) {
                    continue;
                }
            }
            let thickness = thickness_of(is_edge, corners);
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
        n = after(n);
    }
    return found;
}

// The next node in depth-first order that is not below `n`; 0 after the last.
fn after(n: u32) -> u32 {
    let next = (n + 1u) >> firstTrailingBit(n + 1u);
    return select(next, 0u, next == 1u);
}

// `starts` contains the starts of the rows in each half of the lists, then a number for each workgroup of rows: a count
// of pairs at first, then a start.
fn place_of_group(group: u32) -> u32 {
    return 2u * (about.rows + 1u) + group;
}

@compute @workgroup_size(WORKGROUP)
fn count(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let row = item(id, groups);
    let is_due = known.status.detects != 0u && !has_stopped();
    var found = 0u;
    if is_due && row < about.rows {
        found = look_at_row(row, false, 0u);
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
    if is_due && row < about.rows {
        starts[(1u - known.status.half) * (about.rows + 1u) + row] = counts[lane] - found;
    }
    if is_due && lane == WORKGROUP - 1u && row - lane < about.rows {
        starts[place_of_group(row / WORKGROUP)] = counts[lane];
    }
}

// One workgroup computes where the rows of each workgroup start, and checks whether there is room for all pairs.
@compute @workgroup_size(LANES)
fn scan(@builtin(local_invocation_index) lane: u32) {
    let is_due = known.status.detects != 0u;
    let groups = (about.rows + WORKGROUP - 1u) / WORKGROUP;
    let each = (groups + LANES - 1u) / LANES;
    let first = min(lane * each, groups);
    let end = min(first + each, groups);
    var sum = 0u;
    if is_due {
        for (var k = first; k < end; k++) {
            sum = min(sum + starts[place_of_group(k)], MOST_OF_ALL);
        }
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
    if is_due && !has_stopped() {
        var total = all_counts[lane] - sum;
        for (var k = first; k < end; k++) {
            let here = starts[place_of_group(k)];
            starts[place_of_group(k)] = total;
            if k == about.first_edge / WORKGROUP {
                known.status.with_vertices = total;
            }
            total += here;
        }
    }
    workgroupBarrier();
    if is_due && lane == LANES - 1u && !has_stopped() {
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
    let row = item(id, groups);
    if row >= about.rows || known.status.detects == 0u || has_stopped() {
        return;
    }
    let at = known.status.half * (about.rows + 1u) + row;
    let first = starts[at] + starts[place_of_group(row / WORKGROUP)];
    starts[at] = first;
    look_at_row(row, true, first);
}
