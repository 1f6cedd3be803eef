// Refits the trees: starts new paths, then bounds the leaves and all nodes above.

const LANES: u32 = 256u;

// The least margin of a vertex, as a share of its largest, and the least share of the last margin that the next one keeps.
// A detection costs more here, compared with a longer list, than on the CPU, which goes down to a smaller one.
const MIN_MARGIN_SHARE: f32 = 0.5;
const MARGIN_DECAY: f32 = 0.8;
// Weight of the mean displacement since the last detection in that of the next path; the rest is the present one. The first
// includes the response to contact, and vibrates less.
const MEAN: f32 = 0.4;
// Limit on the part that this takes of a vertex's margin.
const ASIDE: f32 = 0.5;
// Distance [m] that counts as nothing. Numbers remain finite if it is divided by.
const MIN_DISTANCE: f32 = 1e-12;

// Number of invocations that bound a leaf.
const PARTS: u32 = 4u;
// Number of those of a workgroup that bounds leaves.
const BOUNDERS: u32 = 128u;

var<workgroup> below: array<Node, 128>;

fn join(a: Node, b: Node) -> Node {
    return Node(
        min(a.place_low, b.place_low),
        max(a.place_high, b.place_high),
        min(a.step_low, b.step_low),
        max(a.step_high, b.step_high),
        min(a.normal_low, b.normal_low),
        max(a.normal_high, b.normal_high),
    );
}

// The number of a tree's leaves, and what its nodes' numbers in `nodes` exceed those in the tree by.
struct Tree {
    leaves: u32,
    before: u32,
}

fn tree_of(is_mesh: bool) -> Tree {
    return Tree(select(leaves(), contact_params.mesh_leaves, is_mesh), select(0u, 2u * leaves(), is_mesh));
}

// Starts the path of each vertex, and chooses how far it may stray from how far it strayed since the last detection.
// Also empties the buckets.
@compute @workgroup_size(WORKGROUP)
fn begin_paths(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= contact_params.all_vertices || !is_due() {
        return;
    }
    for (var k = i; k < arrayLength(&buckets); k += contact_params.all_vertices) {
        atomicStore(&buckets[k], 0u);
    }
    let x_i = vertices[i].x.xyz;
    let u_i = vertices[i].u.xyz;
    // Nothing strays that stands still.
    let max_margin = select(max_margin_of(i), 0.0, i >= contact_params.mesh_first && contact_params.meshes_rest != 0u);
    var margin = max_margin;
    var by = u_i;
    if contact_params.covers_stops != 0u {
        // Contact may stop a vertex anywhere between the common motion and where it is about to move.
        margin = 0.0;
        if vertices[i].x.w > 0.0 {
            margin = length(way_with(i, vertices[i].push.xyz)) + allowance_of(i);
            by = contact_state.status.mean + by_turning(x_i);
        }
    } else if contact_state.status.longer >= 0.0 {
        let track = tracks[i];
        let strayed = (x_i - track.start.xyz) + (u_i - track.by.xyz * contact_state.status.over);
        let far = max(length(strayed) * contact_state.status.longer, MARGIN_DECAY * track.start.w);
        margin = clamp(far, MIN_MARGIN_SHARE * max_margin, max_margin);
        if i < contact_params.vertices {
            let aside = (track.by.xyz + strayed / contact_state.status.over - u_i) * MEAN;
            by += aside * min(1.0, ASIDE * margin / max(length(aside), MIN_DISTANCE));
        }
    }
    tracks[i] = Track(vec4f(x_i, margin), vec4f(by, 1.0 / max(margin, MIN_DISTANCE)));
}

// An invocation's part of the bounds of a leaf.
fn bounds_of_part(leaf: u32, part: u32) -> Node {
    let far = vec3f(MAX_POSITION);
    var node = Node(far, -far, far, -far, far, -far);
    let end = table[contact_params.leaf_triangles + leaf + 1u];
    for (var t = table[contact_params.leaf_triangles + leaf] + part; t < end; t += PARTS) {
        let box = unpacked(boxes[t]);
        node = join(node, Node(box.low, box.high, box.step_low, box.step_high, far, -far));
    }
    // Mesh colliders do not meet themselves.
    if leaf >= leaves() {
        return node;
    }
    for (var k = table[contact_params.around + leaf] + part; k < table[contact_params.around + leaf + 1u]; k += PARTS) {
        let around = normals[table[k]];
        node.normal_low = min(node.normal_low, around.low);
        node.normal_high = max(node.normal_high, around.high);
    }
    return node;
}

// Bounds the leaves, each by several invocations, and the levels above as far as all nodes below are in the same workgroup.
// The workgroups for mesh colliders follow those for the cloth.
@compute @workgroup_size(BOUNDERS)
fn bound(me: Invocation, group: Workgroup) {
    if !is_due_here(me.lane) {
        return;
    }
    let each = BOUNDERS / PARTS;
    let of_cloth = (leaves() + each - 1u) / each;
    let all = number_of(group);
    let is_mesh = all >= of_cloth;
    let tree = tree_of(is_mesh);
    let first = (all - select(0u, of_cloth, is_mesh)) * each;
    let leaf = first + me.lane / PARTS;
    if leaf < tree.leaves {
        below[me.lane] = bounds_of_part(leaf + select(0u, leaves(), is_mesh), me.lane % PARTS);
    }
    let depth = select(contact_params.depth, contact_params.mesh_depth, is_mesh);
    let to_leaf = firstTrailingBit(PARTS);
    for (var width = 1u; width <= min(to_leaf + depth, firstTrailingBit(BOUNDERS)); width++) {
        // The level of the tree, counted from the leaves.
        let level = max(width, to_leaf) - to_leaf;
        let number = (first >> level) + me.lane;
        let is_mine = me.lane < (BOUNDERS >> width);
        workgroupBarrier();
        var node: Node;
        if is_mine {
            node = join(below[2u * me.lane], below[2u * me.lane + 1u]);
            if width >= to_leaf && number < (tree.leaves >> level) {
                nodes[tree.before + (tree.leaves >> level) + number] = node;
            }
        }
        workgroupBarrier();
        if is_mine {
            below[me.lane] = node;
        }
    }
}

// One workgroup for each tree bounds the remaining levels below that with which a descent begins.
@compute @workgroup_size(LANES)
fn refit(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    if !is_due_here(lane) {
        return;
    }
    let is_mesh = group.x > 0u;
    let tree = tree_of(is_mesh);
    let depth = select(contact_params.depth, contact_params.mesh_depth, is_mesh);
    for (var level = depth - min(depth, firstTrailingBit(BOUNDERS / PARTS)); level > first_level(depth) + 1u; level--) {
        let first = 1u << (level - 1u);
        for (var k = first + lane; k < 2u * first; k += LANES) {
            let node = tree.before + k;
            nodes[node] = join(nodes[node + k], nodes[node + k + 1u]);
        }
        storageBarrier();
    }
}
