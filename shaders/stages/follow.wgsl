// A render mesh that follows the cloth. The theory is in src/binding.rs.

@group(1) @binding(0) var<storage, read> bound: array<BoundVertex>;
@group(1) @binding(1) var<storage, read> x: array<vec4f>;
@group(1) @binding(2) var<storage, read> normals: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> positions: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> render_normals: array<vec4f>;

// Whether the render mesh has normals.
override HAS_NORMALS: bool = false;

@compute @workgroup_size(WORKGROUP)
fn follow(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= arrayLength(&positions) {
        return;
    }
    let vertex = bound[i];
    let corners = vertex.corners;
    let a = x[corners.x].xyz;
    let b = x[corners.y].xyz;
    let c = x[corners.z].xyz;
    var position = foot(vertex, a, b, c);
    if HAS_NORMALS || vertex.height != 0.0 {
        let normal = cloth_normal(vertex, a, b, c, array(normals[corners.x].xyz, normals[corners.y].xyz, normals[corners.z].xyz));
        position += normal * vertex.height;
        if HAS_NORMALS {
            render_normals[i] = vec4f(render_normal(vertex, a, b, c, normal), 0.0);
        }
    }
    positions[i] = vec4f(position, 1.0);
}
