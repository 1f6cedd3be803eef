// A render mesh that follows the cloth: each vertex stands at some height above an affine combination of a triangle's
// corners. The theory is in src/binding.rs.

struct BoundVertex {
    corners: vec3u,
    // The height along the normal (m).
    along: f32,
    weights: vec3f,
    padding_1: u32,
    // Of the normals of the corners; all 0 for the triangle's own normal.
    normal_weights: vec3f,
    padding_2: u32,
}

@group(1) @binding(0) var<storage, read> bound: array<BoundVertex>;
@group(1) @binding(1) var<storage, read> x: array<vec4f>;
@group(1) @binding(2) var<storage, read> normals: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> positions: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn follow(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= arrayLength(&positions) {
        return;
    }
    let vertex = bound[i];
    let c = vertex.corners;
    let x0 = x[c.x].xyz;
    let x1 = x[c.y].xyz;
    let x2 = x[c.z].xyz;
    var position = x0 * vertex.weights.x + x1 * vertex.weights.y + x2 * vertex.weights.z;
    if vertex.along != 0.0 {
        let weights = vertex.normal_weights;
        var normal = unit(normals[c.x].xyz * weights.x + normals[c.y].xyz * weights.y + normals[c.z].xyz * weights.z);
        if all(normal == vec3f()) {
            normal = unit(cross(x1 - x0, x2 - x0));
        }
        position += normal * vertex.along;
    }
    positions[i] = vec4f(position, 1.0);
}
