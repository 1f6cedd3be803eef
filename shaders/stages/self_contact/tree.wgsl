// Refits the tree: starts new paths, then bounds the leaves and all nodes above. Nodes are numbered like a binary heap,
// the root being 1.

override LANES: u32 = 256u;

// The least distance that a vertex may stray, as a multiple of the thickness, and the least share that it keeps of the
// last one.
const LEAST_STRAY: f32 = 0.1;
const KEEPS: f32 = 0.8;

var<workgroup> below: array<Node, WORKGROUP>;

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

// Starts the path of each vertex, and chooses how far it may stray from how far it strayed since the last detection.
// Also empties the chains.
@compute @workgroup_size(WORKGROUP)
fn begin_paths(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= about.vertices || !is_due() {
        return;
    }
    for (var k = i; k < arrayLength(&chains); k += about.vertices) {
        atomicStore(&chains[k], 0u);
    }
    let x_i = x[i].xyz;
    let u_i = vertices[i].u.xyz;
    let most = roam_of(i);
    var stray = most;
    if known.status.longer >= 0.0 {
        let track = tracks[i];
        let far = length((x_i - track.start.xyz) + (u_i - track.by.xyz * known.status.over)) * known.status.longer;
        let least = min(LEAST_STRAY * about.thickness, most);
        stray = clamp(max(far, KEEPS * track.start.w), least, most);
    }
    tracks[i] = Track(vec4f(x_i, stray), vec4f(u_i, 1.0 / stray));
    vertices[i].middle = vec4f(x_i + u_i * (0.5 * known.status.ahead), stray);
}

fn normal_of(a: vec3f, b: vec3f, c: vec3f) -> vec3f {
    let n = cross(b - a, c - a);
    let size = length(n);
    return select(vec3f(), n / size, size > 0.0);
}

fn node_of_leaf(leaf: u32) -> Node {
    let far = vec3f(MAX_POSITION);
    var node = Node(far, -far, far, -far, far, -far);
    for (var t = table[about.leaf_triangles + leaf]; t < table[about.leaf_triangles + leaf + 1u]; t++) {
        let corners = triangle(t);
        for (var k = 0u; k < 3u; k++) {
            let y = vertices[corners[k]].middle;
            let u = vertices[corners[k]].u.xyz;
            node.place_low = min(node.place_low, y.xyz - y.w);
            node.place_high = max(node.place_high, y.xyz + y.w);
            node.step_low = min(node.step_low, u);
            node.step_high = max(node.step_high, u);
        }
        let u = Four(vertices[corners.x].u.xyz, vertices[corners.y].u.xyz, vertices[corners.z].u.xyz, vec3f());
        let before = normal_of(x[corners.x].xyz, x[corners.y].xyz, x[corners.z].xyz);
        let after = normal_of(
            x[corners.x].xyz + u.a * known.status.ahead,
            x[corners.y].xyz + u.b * known.status.ahead,
            x[corners.z].xyz + u.c * known.status.ahead,
        );
        node.normal_low = min(node.normal_low, min(before, after));
        node.normal_high = max(node.normal_high, max(before, after));
    }
    return node;
}

// Bounds the leaves, and the levels above as far as all nodes below are in the same workgroup.
@compute @workgroup_size(WORKGROUP)
fn bound(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if !looks_here(lane) {
        return;
    }
    let leaf = item(id, groups);
    let leaves = 1u << about.depth;
    if leaf < leaves {
        below[lane] = node_of_leaf(leaf);
        nodes[leaves + leaf] = below[lane];
    }
    let levels = min(about.depth, firstTrailingBit(WORKGROUP));
    for (var level = 1u; level <= levels; level++) {
        let first = (leaf - lane) >> level;
        let is_mine = lane < (WORKGROUP >> level) && first + lane < (leaves >> level);
        workgroupBarrier();
        var node: Node;
        if is_mine {
            node = join(below[2u * lane], below[2u * lane + 1u]);
            nodes[(leaves >> level) + first + lane] = node;
        }
        workgroupBarrier();
        if is_mine {
            below[lane] = node;
        }
    }
}

// One workgroup bounds the remaining levels.
@compute @workgroup_size(LANES)
fn refit(@builtin(local_invocation_index) lane: u32) {
    if !looks_here(lane) {
        return;
    }
    let done = min(about.depth, firstTrailingBit(WORKGROUP));
    for (var level = about.depth - done; level > 0u; level--) {
        let first = 1u << (level - 1u);
        for (var k = first + lane; k < 2u * first; k += LANES) {
            nodes[k] = join(nodes[2u * k], nodes[2u * k + 1u]);
        }
        storageBarrier();
    }
}
