// Fills the vertex buffer of a Bevy mesh from the cloth's own buffers: between its last two steps, in the order of the mesh.

struct Fill {
    // What the cloth's positions are less.
    origin: vec3f,
    // How far from the last step but one (0) to the last one (1).
    part: f32,
    // The mesh's first vertex in the buffer, which holds many meshes.
    first: u32,
    count: u32,
}

// Numbers of a vertex: position, normal, texture coordinates.
const STRIDE = 8u;

@group(0) @binding(0) var<uniform> fill: Fill;
@group(0) @binding(1) var<storage, read> old_positions: array<vec4f>;
@group(0) @binding(2) var<storage, read> old_normals: array<vec4f>;
@group(0) @binding(3) var<storage, read> positions: array<vec4f>;
@group(0) @binding(4) var<storage, read> normals: array<vec4f>;
// The mesh's vertex of each of the cloth's.
@group(0) @binding(5) var<storage, read> order: array<u32>;
@group(0) @binding(6) var<storage, read_write> vertices: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) thread: vec3u) {
    let place = thread.x;
    if place >= fill.count {
        return;
    }
    let position = fill.origin + mix(old_positions[place].xyz, positions[place].xyz, fill.part);
    let between = mix(old_normals[place].xyz, normals[place].xyz, fill.part);
    // Opposite normals have no middle.
    let normal = select(normals[place].xyz, normalize(between), dot(between, between) > 1e-12);
    let at = (fill.first + order[place]) * STRIDE;
    for (var axis = 0u; axis < 3u; axis += 1u) {
        vertices[at + axis] = position[axis];
        vertices[at + 3u + axis] = normal[axis];
    }
}
