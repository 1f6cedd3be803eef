// Contact of the cloth with itself and with mesh colliders: declarations shared by its stages. The files in src/contact
// with the same names have the theory.
//
// Each stage binds the resources that it uses. Results do not depend on the order of invocations: values that several
// invocations write are maxima, minima or sums of integers.

struct ContactParams {
    thickness: f32,
    friction: f32,
    // Number of the cloth's vertices. Those of mesh colliders follow: the first, and the number of all vertices.
    vertices: u32,
    mesh_first: u32,
    all_vertices: u32,
    // First features of pairs are numbered, the vertices before the edges; how many numbers there are.
    rows: u32,
    // Levels below the roots of the trees over the cloth and over mesh colliders, and number of the latter's leaves: 0
    // if there are no mesh colliders.
    depth: u32,
    mesh_depth: u32,
    mesh_leaves: u32,
    // Positions of the lists in the table. Those of leaves have the first triangle, edge, and place in `order` of each.
    triangles: u32,
    edges: u32,
    order: u32,
    leaf_triangles: u32,
    leaf_edges: u32,
    leaf_vertices: u32,
    excess: u32,
    around: u32,
    beside: u32,
    of_vertices: u32,
    // Number of pairs that the list has room for; number of colliders.
    room: u32,
    bodies: u32,
    // Whether there are kinematic vertices (of pins or mesh colliders): 0, 1, or 2 if there are only mesh colliders that cannot meet
    // the cloth in this step. Whether all mesh colliders stand still in this step, and whether contact of the cloth with itself is on;
    // 1 or 0.
    has_kinematic: u32,
    meshes_rest: u32,
    has_self_contact: u32,
    // Numbers of ignored pairs: of a vertex and a triangle, and of two edges.
    ignored: u32,
    ignored_edges: u32,
    // Numbers of workgroups that cover the vertices of the cloth and of mesh colliders; inverse of the cloth's mass [1/kg].
    groups: u32,
    mesh_groups: u32,
    per_mass: f32,
    // Where the boxes of edges start, after those of the triangles; the most features of a leaf.
    box_edges: u32,
    features: u32,
    // In every so many substeps detection may be due.
    spacing: u32,
    // How far vertices may be carried besides the common motion [m]: at first 0, so that a pair that is run over stops the step;
    // and the number of vertices that are not carried, which are behind the ignored pairs, sorted.
    max_carry: f32,
    entangled: u32,
    // Position in the table of the lists of each vertex's triangles.
    triangles_at: u32,
    // Whether all pairs are listed that may meet wherever on their ways contact stops vertices.
    covers_stops: u32,
    // The rotation in the first substep, less the identity and by columns, of kinematic vertices, if they turn as one
    // (otherwise 0); its center [m], and the center's displacement in the step [m].
    turn_x: vec4f,
    turn_y: vec4f,
    turn_z: vec4f,
    center: vec4f,
    travel: vec4f,
}

// A listed pair. Its first feature is number `row`, `other` is the second. `next` leads to another pair of its bucket.
struct Listed {
    corners: vec4u,
    // Multipliers [kg m]: xyz of friction, w of the normal.
    lambda: vec4f,
    other: u32,
    thickness: f32,
    row: u32,
    next: u32,
}

// A near pair in this substep: corners, their weights, multipliers, and its index in the list.
struct Near {
    corners: vec4u,
    weights: vec4f,
    normal: vec3f,
    distance: f32,
    lambda: vec4f,
    thickness: f32,
    rate: f32,
    listed: u32,
    friction: f32,
}

// A vertex in this substep. `x`: position; w is the inverse mass, 0 if it is kinematic. `u`: displacement; w is the inverse mass
// again, so that it is not read apart. `push`: correction that adds no velocity; w is the coefficient of friction of a mesh
// collider's vertex. `way`, of the cloth's vertices: during the response the displacement by the predictor, the constraints and the
// impulses of pairs, without the colliders, of which contact with these is a function; then displacement and correction together,
// relative to the mean displacement. w is how far it was about to move, then how far it may move.
struct Vertex {
    x: vec4f,
    u: vec4f,
    push: vec4f,
    way: vec4f,
}

// The path that detection assumes: start, with the distance that the vertex may stray in w; displacement per substep,
// with its inverse in w. The paths of all vertices are followed by the motions in this step of those of mesh colliders:
// start, with the coefficient of friction in w; displacement.
struct Track {
    start: vec4f,
    by: vec4f,
}

// Bounds of a tree node: places at the midpoints of the paths, and displacements per substep; also the normals of all
// triangles at its vertices.
struct Node {
    place_low: vec3f,
    place_high: vec3f,
    step_low: vec3f,
    step_high: vec3f,
    normal_low: vec3f,
    normal_high: vec3f,
}

// One workgroup's part of a reduction over all vertices.
struct Part {
    low: vec4f,
    high: vec4f,
}

struct Status {
    // Kept between steps: which half of the lists is current, the number of pairs in it, how many of these are of a
    // vertex and a triangle, and how many of two edges.
    half: u32,
    listed: atomic<u32>,
    with_vertices: atomic<u32>,
    with_edges: atomic<u32>,
    // Number of substeps since the last detection (below 0: none yet), as of the end of the last substep that `decide`
    // counted, and number that it covers; length of the last substep [s].
    since: f32,
    ahead: f32,
    h: f32,
    // Of this step: reasons to stop it, number of pairs needed if there is not enough room, number of detections.
    stopped: atomic<u32>,
    needed: atomic<u32>,
    detections: u32,
    // Of this substep: number of near pairs that only truncation holds, of pairs that act, and of these with a normal
    // impulse; whether a vertex strayed too far; the longest correction by a collider [m], as bits and as a number.
    near: atomic<u32>,
    acting: atomic<u32>,
    pressing: atomic<u32>,
    strayed: atomic<u32>,
    most_push: atomic<u32>,
    pushed: f32,
    // Whether detection is due (1 or 0); factor on the deviations from the last paths, for the new limits (below 0:
    // none); number of substeps of these paths; factor on the multipliers of the last substep.
    detects: u32,
    longer: f32,
    over: f32,
    scale: f32,
    // The common motion's displacement [m] besides its rotation (`by_turning`).
    mean: vec3f,
    // Number of substeps of this step up to which `since` is counted.
    counted: u32,
    // Numbers of pairs of either kind in the previous list.
    vertices_before: u32,
    edges_before: u32,
    // Of the last detection: numbers of pairs of leaves that meet, and of candidates: of a vertex and a triangle, and of two
    // edges.
    leaf_pairs: atomic<u32>,
    candidates: atomic<u32>,
    edge_candidates: atomic<u32>,
    // Of this step: the space needed for these if there is not enough.
    space_needed: atomic<u32>,
    // Number of pairs that acted in the previous substep.
    acted: u32,
    // Number of pairs of this substep whose plane has passed a vertex, and of those of this step that are pinched without having moved
    // through each other: see `through`.
    passed: atomic<u32>,
    pinched: atomic<u32>,
    // Whether displacements are to be truncated once more (above 0), because vertices slide or were carried just now; as bits, how
    // far they would have to be carried [m] besides the common motion, at most, if the step stopped for that reason.
    again: atomic<u32>,
    needed_carry: atomic<u32>,
    // Number of pairs of this substep that are squeezed.
    squeezed: atomic<u32>,
    // Whether a vertex was pushed out of colliders by more than the thickness in this step (1 or 0). It may jump over others.
    jumped: atomic<u32>,
    // Whether truncation shortens a displacement in this substep, and its second round one that the first one has not (1 or 0).
    shortens: atomic<u32>,
    cuts_more: atomic<u32>,
    // Number of times that vertices drift in this step.
    drifted: atomic<u32>,
    // Number of pairs of this step that have moved through each other.
    through: atomic<u32>,
}

// There is room for so many pairs that are pinched, as many that have moved through each other, and so many vertices that drift.
// There may be more.
const PINCHED: u32 = 64u;
const DRIFTED: u32 = 256u;
// Marks the first vertex of a pair of edges that is pinched, or whose plane has passed a vertex.
const MARK: u32 = 0x80000000u;

// The status, the corners of pairs that have moved through each other and of others that are pinched, and the vertices that drift,
// followed by the workgroups' parts of a reduction over the cloth, and by those over mesh colliders. The first are reported, so the
// others, of which there are more, must not take their places.
struct ContactState {
    status: Status,
    through: array<vec4u, PINCHED>,
    pinched: array<vec4u, PINCHED>,
    drifted: array<u32, DRIFTED>,
    parts: array<Part>,
}

@group(1) @binding(0) var<uniform> contact_params: ContactParams;
@group(1) @binding(1) var<storage, read> table: array<u32>;
@group(1) @binding(2) var<storage, read> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> vertices: array<Vertex>;
@group(1) @binding(4) var<storage, read_write> tracks: array<Track>;
@group(1) @binding(5) var<storage, read_write> nodes: array<Node>;
@group(1) @binding(6) var<storage, read_write> buckets: array<atomic<u32>>;
@group(1) @binding(7) var<storage, read_write> pairs: array<Listed>;
@group(1) @binding(8) var<storage, read_write> near: array<vec4u>;
@group(1) @binding(9) var<storage, read_write> sums: array<atomic<i32>>;
@group(1) @binding(10) var<storage, read_write> contact_state: ContactState;
@group(1) @binding(11) var<storage, read> bodies: array<Body>;
@group(1) @binding(12) var<storage, read> ignored: array<vec2u>;
@group(1) @binding(13) var<storage, read_write> x_out: array<vec4f>;
@group(1) @binding(14) var<storage, read_write> p_out: array<vec4f>;

// Reasons to stop a step.
const NO_ROOM: u32 = 1u;
const NOT_FINITE: u32 = 2u;
const CROWDED: u32 = 4u;
const EARLY: u32 = 8u;
const CLOSE: u32 = 16u;
const RUN_OVER: u32 = 32u;

// Number of integers per vertex, and their indices: the sum of weights, three for impulses, three for corrections, and the bits
// of the share that truncation leaves. After the response, the first four tell how far truncation finds the vertex beyond planes
// (the sum of squares, and a vector), and the fifth, as bits, which share the second round of truncation takes from it; between
// `finish` and the end of the substep the first is `LEADER` of carry.wgsl.
const SUMS: u32 = 8u;
const WEIGHT: u32 = 0u;
const IMPULSE: u32 = 1u;
const PUSHED: u32 = 4u;
const SHARE: u32 = 7u;
const SQUARES: u32 = 0u;
const BEYOND: u32 = 1u;
const CUT: u32 = 4u;
// The integers that represent a weight of 1, and a length of one thickness.
const UNIT_WEIGHT: f32 = 262144.0;
const UNIT_LENGTH: f32 = 8388608.0;
// The same for what all pairs of a vertex add, of which there may be thousands beside fine bodies.
const UNIT_BEYOND: f32 = 262144.0;

// The number in the list of a near pair: see `near_at`.
fn listed_at(k: u32) -> u32 {
    return near[4u * contact_params.room + k].z;
}

// The place among the listed pairs at which the corners of a pair are told whose plane has passed a vertex: in the half
// of the list that only detection needs, so that there is room for all.
fn place_of_passed(k: u32) -> u32 {
    return (1u - contact_state.status.half) * contact_params.room + k;
}

// Whether there are no kinematic vertices that may meet the cloth in this step.
fn is_free() -> bool {
    return contact_params.has_kinematic != 1u;
}

// Whether there are none anywhere, so that only the motion of the cloth's vertices relative to each other matters to detection.
fn floats() -> bool {
    return contact_params.has_kinematic == 0u;
}

fn by_first_turn(r: vec3f) -> vec3f {
    return contact_params.turn_x.xyz * r.x + contact_params.turn_y.xyz * r.y + contact_params.turn_z.xyz * r.z;
}

// The displacement [m] by rotation, in the common motion of the cloth, of what is at x. Kinematic vertices move in a
// straight line during a step, as in the first substep, so x is first traced back to the start of the step, to first
// order.
fn by_turning(x: vec3f) -> vec3f {
    let r = x - contact_params.center.xyz - contact_params.travel.xyz * substep.start;
    return by_first_turn(r - by_first_turn(r) * (substep.start * f32(params.substeps)));
}

// A displacement as it appears in what turns with the common motion.
fn without_turning(by: vec3f) -> vec3f {
    return by + vec3f(dot(contact_params.turn_x.xyz, by), dot(contact_params.turn_y.xyz, by), dot(contact_params.turn_z.xyz, by));
}

// How far a vertex moves relative to the common motion, with a correction.
fn way_with(v: u32, push: vec3f) -> vec3f {
    return vertices[v].u.xyz + push - contact_state.status.mean - by_turning(vertices[v].x.xyz);
}

// Whether a pair is in a part of `ignored`, which is sorted.
fn is_among(pair: vec2u, first: u32, count: u32) -> bool {
    var low = first;
    var high = first + count;
    while low < high {
        let middle = (low + high) / 2u;
        let other = ignored[middle];
        if other.x < pair.x || (other.x == pair.x && other.y < pair.y) {
            low = middle + 1u;
        } else if all(other == pair) {
            return true;
        } else {
            high = middle;
        }
    }
    return false;
}

fn has_stopped() -> bool {
    return atomicLoad(&contact_state.status.stopped) != 0u;
}

fn index_of_substep() -> u32 {
    return u32(round(substep.start * f32(params.substeps)));
}

// Number of substeps since the last detection at the start of this one; below 0 if there was none.
fn since() -> f32 {
    return contact_state.status.since + f32(index_of_substep() - contact_state.status.counted);
}

fn is_due() -> bool {
    return contact_state.status.detects != 0u && !has_stopped();
}

// A number that the first invocation of a workgroup loads for all, because a device is slow when all load from one place.
var<workgroup> total: u32;

// Whether detection is due, for all invocations of a workgroup.
fn is_due_here(lane: u32) -> bool {
    if lane == 0u {
        total = u32(is_due());
    }
    return workgroupUniformLoad(&total) != 0u;
}

fn number(at: u32) -> f32 {
    return bitcast<f32>(table[at]);
}

fn triangle(t: u32) -> vec3u {
    let at = contact_params.triangles + 3u * t;
    return vec3u(table[at], table[at + 1u], table[at + 2u]);
}

fn edge(e: u32) -> vec2u {
    let at = contact_params.edges + 2u * e;
    return vec2u(table[at], table[at + 1u]);
}

fn piece_of(v: u32) -> u32 {
    return table[contact_params.of_vertices + 6u * v];
}

// How much farther contact may move a vertex than it was about to move: `Surface::allowance`.
fn allowance_of(v: u32) -> f32 {
    return number(contact_params.of_vertices + 6u * v + 1u);
}

// Sides that come closer than this, by what they are about to move, may meet in this substep: their thickness or, where that is
// less, how much farther contact may move them.
fn reach(is_edge: bool, thickness: f32, c: vec4u) -> f32 {
    // The full thickness is more than contact lets any vertices move.
    if thickness >= contact_params.thickness {
        return thickness;
    }
    return max(thickness, sum_of_sides(is_edge, vec4f(allowance_of(c.x), allowance_of(c.y), allowance_of(c.z), allowance_of(c.w))));
}

// The sum of the largest value at a corner of either side.
fn sum_of_sides(is_edge: bool, at: vec4f) -> f32 {
    let most = max(at.z, at.w);
    return select(at.x + max(at.y, most), max(at.x, at.y) + most, is_edge);
}

fn max_margin_of(v: u32) -> f32 {
    return number(contact_params.of_vertices + 6u * v + 2u);
}

fn rest_of(v: u32) -> vec3f {
    let at = contact_params.of_vertices + 6u * v + 3u;
    return vec3f(number(at), number(at + 1u), number(at + 2u));
}

fn positions(corners: vec4u) -> Four {
    return Four(vertices[corners.x].x.xyz, vertices[corners.y].x.xyz, vertices[corners.z].x.xyz, vertices[corners.w].x.xyz);
}

fn displacements(corners: vec4u) -> Four {
    return Four(vertices[corners.x].u.xyz, vertices[corners.y].u.xyz, vertices[corners.z].u.xyz, vertices[corners.w].u.xyz);
}
