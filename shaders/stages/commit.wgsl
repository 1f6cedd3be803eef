// Runs once per step: if the state that the last substep produced is within bounds, it becomes the cloth's state,
// otherwise the cloth stays as it was. Nothing is read back for this.

@group(1) @binding(0) var<storage, read> x_made: array<vec4f>;
@group(1) @binding(1) var<storage, read> p_made: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> p: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> found: Defects;
// The ends of each edge that is swept; an edge without stiffness is given one vertex twice, so that it is never too
// long.
@group(1) @binding(5) var<storage, read> ends: array<vec2u>;

// Where the substeps were not made by tiles, which check their own.
@compute @workgroup_size(WORKGROUP)
fn check(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if found.stopped != 0u {
        return;
    }
    if i < params.vertices {
        check_vertex(i, x_made[i].xyz, p_made[i].xyz, x_made[i].w);
    }
    let each = max((params.edges + TURNS - 1u) / TURNS, FEWEST_CHECKED);
    let parts = max((params.edges + each - 1u) / each, 1u);
    let k = (found.steps + 1u) % parts * each + i;
    if i < each && k < params.edges && is_long(x_made[ends[k].x].xyz - x_made[ends[k].y].xyz) {
        atomicMin(&found.long, k);
    }
}

@compute @workgroup_size(WORKGROUP)
fn commit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i == 0u {
        end_of_watch();
    }
    if i < params.vertices && !has_failed() {
        x[i] = x_made[i];
        p[i] = p_made[i];
    }
}
