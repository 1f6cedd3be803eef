// Boxes around paths, and whether they come close within the substeps that detection covers.
//
// The nodes of a tree are numbered like a binary heap, its root being 1. The leaves and the nodes of the tree over mesh
// colliders follow those of the tree over the cloth.

// The box within which some vertices may stray, and the range of their displacements.
struct Box {
    low: vec3f,
    high: vec3f,
    step_low: vec3f,
    step_high: vec3f,
}

// A box without gaps, which is read in three loads.
struct StoredBox {
    a: vec4f,
    b: vec4f,
    c: vec4f,
}

// The boxes of the triangles, followed by those of the edges and by those of the vertices in `order`.
@group(1) @binding(15) var<storage, read_write> boxes: array<StoredBox>;

fn packed(box: Box) -> StoredBox {
    return StoredBox(vec4f(box.low, box.high.x), vec4f(box.high.yz, box.step_low.xy), vec4f(box.step_low.z, box.step_high));
}

fn unpacked(box: StoredBox) -> Box {
    return Box(box.a.xyz, vec3f(box.a.w, box.b.xy), vec3f(box.b.zw, box.c.x), box.c.yzw);
}

// The midpoint of a vertex's path, with the distance that it may stray in w, and its displacement.
struct Place {
    middle: vec4f,
    u: vec3f,
}

fn place_at(v: u32) -> Place {
    let track = tracks[v];
    return Place(vec4f(track.start.xyz + track.by.xyz * (0.5 * contact_state.status.ahead), track.start.w), track.by.xyz);
}

fn box_of(a: Place) -> Box {
    return Box(a.middle.xyz - a.middle.w, a.middle.xyz + a.middle.w, a.u, a.u);
}

fn box_with(a: Box, b: Place) -> Box {
    return Box(
        min(a.low, b.middle.xyz - b.middle.w),
        max(a.high, b.middle.xyz + b.middle.w),
        min(a.step_low, b.u),
        max(a.step_high, b.u),
    );
}

fn box_of_first_vertex() -> u32 {
    return contact_params.box_edges + contact_params.rows - contact_params.all_vertices;
}

fn box_of_feature(k: u32) -> Box {
    if k < contact_params.box_edges {
        let corners = triangle(k);
        return box_with(box_with(box_of(place_at(corners.x)), place_at(corners.y)), place_at(corners.z));
    }
    if k < box_of_first_vertex() {
        let ends = edge(k - contact_params.box_edges);
        return box_with(box_of(place_at(ends.x)), place_at(ends.y));
    }
    return box_of(place_at(table[contact_params.order + k - box_of_first_vertex()]));
}

// The level of each tree with whose nodes a descent begins, unless the leaves are above it. It tests their children, so bounds
// of the nodes down to this level are not needed.
const FIRST_LEVEL: u32 = 6u;

// The level of a tree that a descent begins with. Above the root of a tree without other levels is node 0, which is not in
// the tree.
fn first_level(depth: u32) -> u32 {
    return min(FIRST_LEVEL, max(depth, 1u) - 1u);
}

// Number of leaves of the cloth.
fn leaves() -> u32 {
    return 1u << contact_params.depth;
}

// What the number of a node exceeds that in its own tree by.
fn before_tree(node: u32) -> u32 {
    return select(0u, 2u * leaves(), node >= 2u * leaves());
}

fn box_of_node(n: u32) -> Box {
    return Box(nodes[n].place_low, nodes[n].place_high, nodes[n].step_low, nodes[n].step_high);
}

fn are_apart(a: Box, b: Box) -> bool {
    let relative = max(max(a.step_high - b.step_low, b.step_high - a.step_low), vec3f());
    let gap = max(a.low - b.high, b.low - a.high);
    return any(gap > relative * (0.5 * contact_state.status.ahead) + contact_params.thickness);
}
