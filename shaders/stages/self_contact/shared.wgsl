// Contact of the cloth with itself: what its stages share. The reasons are in src/contact, file by file under the same names.
//
// Every stage binds what it uses of this list. Nothing depends on which invocation comes first: what several write to is a maximum, a
// minimum, or a sum of integers.

struct About {
    thickness: f32,
    friction: f32,
    vertices: u32,
    // Rows of the lists: one for each vertex, up to a whole number of workgroups, then one for each edge.
    first_edge: u32,
    rows: u32,
    depth: u32,
    // Where each list of the table begins.
    triangles: u32,
    edges: u32,
    leaves: u32,
    of_leaves: u32,
    excess: u32,
    beside: u32,
    of_vertices: u32,
    // Pairs that there is room for, and colliders.
    room: u32,
    bodies: u32,
    // Vertices that are pinned.
    pins: u32,
    // Pairs that are let go: of a vertex and a triangle, then of two edges.
    let_go: u32,
    let_go_of_edges: u32,
    // Workgroups that go over all vertices.
    groups: u32,
    per_mass: f32,
}

// A listed pair. `other` is its second feature, the first is its row.
struct Listed {
    corners: vec4u,
    // Along the friction, w along the normal [kg m].
    lambda: vec4f,
    other: u32,
    thickness: f32,
}

// A near pair in this substep: its corners and their weights, what holds it apart, and where it is listed.
struct Near {
    corners: vec4u,
    weights: vec4f,
    normal: vec3f,
    distance: f32,
    lambda: vec4f,
    thickness: f32,
    rate: f32,
    listed: u32,
}

// A vertex in this substep. `u` is its displacement, w how far it was on its way to go; `push` what moves it besides; `middle` where it
// is in the middle of its path, w how far it may stray from that.
struct Vertex {
    u: vec4f,
    push: vec4f,
    middle: vec4f,
}

// The path that detection looked along: from where, w how far the vertex may stray; by how much in a substep.
struct Track {
    start: vec4f,
    by: vec4f,
}

// What a node of the tree bounds: places, steps and normals, the least and the greatest.
struct Node {
    place_low: vec3f,
    place_high: vec3f,
    step_low: vec3f,
    step_high: vec3f,
    normal_low: vec3f,
    normal_high: vec3f,
}

// A part of what is gathered over all vertices.
struct Part {
    low: vec4f,
    high: vec4f,
}

struct Status {
    // Goes on from step to step. Which half of the lists is in force, and how many pairs are in it, the first so many of a vertex.
    half: u32,
    listed: u32,
    with_vertices: u32,
    // Substeps since detection, below 0 if there was none; how many it looked ahead; the last substep's length [s].
    since: f32,
    ahead: f32,
    h: f32,
    // Of the step: why it must be taken back, how many pairs there were no room for, detections.
    stopped: atomic<u32>,
    needed: atomic<u32>,
    detections: u32,
    // Of the substep: pairs that are only kept from crossing, those that act, of these those that press; whether anything strayed, the most
    // that a collider pushes [m], by its bits.
    near: atomic<u32>,
    acting: atomic<u32>,
    pressing: atomic<u32>,
    strayed: atomic<u32>,
    most_push: atomic<u32>,
    pushed: f32,
    // 1 if detection is due; how the ways since the last are to be weighed, over how many substeps they were; what multipliers are scaled by.
    detects: u32,
    longer: f32,
    over: f32,
    scale: f32,
    // How the cloth moves as a whole [m].
    mean: vec3f,
}

// And the parts of what is gathered, one of each workgroup.
struct Known {
    status: Status,
    parts: array<Part>,
}

@group(1) @binding(0) var<uniform> about: About;
@group(1) @binding(1) var<storage, read> table: array<u32>;
@group(1) @binding(2) var<storage, read> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> vertices: array<Vertex>;
@group(1) @binding(4) var<storage, read_write> tracks: array<Track>;
@group(1) @binding(5) var<storage, read_write> nodes: array<Node>;
@group(1) @binding(6) var<storage, read_write> starts: array<u32>;
@group(1) @binding(7) var<storage, read_write> pairs: array<Listed>;
@group(1) @binding(8) var<storage, read_write> near: array<Near>;
@group(1) @binding(9) var<storage, read_write> sums: array<atomic<i32>>;
@group(1) @binding(10) var<storage, read_write> known: Known;
@group(1) @binding(11) var<storage, read> bodies: array<Body>;
@group(1) @binding(12) var<storage, read> let_go: array<vec2u>;
@group(1) @binding(13) var<storage, read_write> x_out: array<vec4f>;
@group(1) @binding(14) var<storage, read_write> p_out: array<vec4f>;

// Why a step stops.
const NO_ROOM: u32 = 1u;
const NOT_FINITE: u32 = 2u;
const CROWDED: u32 = 4u;
const EARLY: u32 = 8u;

// Integers that are summed for each vertex, and where they begin: weights, three of what pairs give, three of what they push; and the bits of
// the share that may be taken.
const SUMS: u32 = 8u;
const WEIGHT: u32 = 0u;
const GIVEN: u32 = 1u;
const PUSHED: u32 = 4u;
const SHARE: u32 = 7u;
// What a weight of 1 is in integers, and a thickness.
const UNIT_WEIGHT: f32 = 262144.0;
const UNIT_LENGTH: f32 = 8388608.0;

fn has_stopped() -> bool {
    return atomicLoad(&known.status.stopped) != 0u;
}

fn number(at: u32) -> f32 {
    return bitcast<f32>(table[at]);
}

fn triangle(t: u32) -> vec3u {
    let at = about.triangles + 3u * t;
    return vec3u(table[at], table[at + 1u], table[at + 2u]);
}

fn edge(e: u32) -> vec2u {
    let at = about.edges + 2u * e;
    return vec2u(table[at], table[at + 1u]);
}

fn piece_of(v: u32) -> u32 {
    return table[about.of_vertices + 6u * v];
}

fn reach_of(v: u32) -> f32 {
    return number(about.of_vertices + 6u * v + 1u);
}

fn roam_of(v: u32) -> f32 {
    return number(about.of_vertices + 6u * v + 2u);
}

fn rest_of(v: u32) -> vec3f {
    let at = about.of_vertices + 6u * v + 3u;
    return vec3f(number(at), number(at + 1u), number(at + 2u));
}
