// Vertex normals for drawing: the sum of the normals of the triangles around each vertex, weighted by area.

// Three corners per triangle, as in an index buffer.
@group(1) @binding(0) var<storage, read> triangles: array<u32>;
@group(1) @binding(1) var<storage, read> spans: array<Span>;
@group(1) @binding(2) var<storage, read> around: array<u32>;
@group(1) @binding(3) var<storage, read> x: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> normals: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn gather_normals(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i >= arrayLength(&normals) {
        return;
    }
    var sum = vec3f();
    for (var k = spans[i].start; k < spans[i].end; k++) {
        let corner = 3u * around[k];
        let x0 = x[triangles[corner]].xyz;
        let x1 = x[triangles[corner + 1u]].xyz;
        let x2 = x[triangles[corner + 2u]].xyz;
        sum += cross(x1 - x0, x2 - x0);
    }
    normals[i] = vec4f(unit(sum), 0.0);
}
