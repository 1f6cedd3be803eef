// Runs once per step: if the state that the last substep produced is within bounds, it becomes the cloth's state,
// otherwise the cloth stays as it was. Nothing is read back for this.

@group(1) @binding(0) var<storage, read> x_made: array<vec4f>;
@group(1) @binding(1) var<storage, read> p_made: array<vec4f>;
@group(1) @binding(2) var<storage, read_write> x: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> p: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> found: Found;
// The ends of each edge that is swept; an edge without stiffness is given one vertex twice, so that it is never too
// long.
@group(1) @binding(5) var<storage, read> ends: array<vec2u>;

// Each invocation's share of the allowed kinetic energy.
var<workgroup> shares: array<f32, WORKGROUP>;

// Number of edges that a step checks.
fn edges_each() -> u32 {
    return max((params.edges + TURNS - 1u) / TURNS, min(LEAST, params.edges));
}

@compute @workgroup_size(WORKGROUP)
fn check(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = item(id, groups);
    let looks = found.stopped == 0u;
    var share = 0.0;
    if looks && i < params.vertices {
        share = energy_share(p_made[i].xyz, free_mass(x_made[i].w));
        look_at_vertex(i, x_made[i].xyz, p_made[i].xyz, share);
    }
    if looks && i < edges_each() {
        let k = (found.next + i) % params.edges;
        if is_long(x_made[ends[k].x].xyz - x_made[ends[k].y].xyz) {
            atomicMin(&found.long, k);
        }
    }
    shares[lane] = share;
    for (var width = WORKGROUP / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if lane < width {
            shares[lane] += shares[lane + width];
        }
    }
    if lane == 0u && shares[0] > 0.0 {
        add_energy(shares[0]);
    }
}

@compute @workgroup_size(WORKGROUP)
fn commit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let i = item(id, groups);
    if i == 0u {
        end_of_watch(params.edges, edges_each());
    }
    if i < params.vertices && !has_failed() {
        x[i] = x_made[i];
        p[i] = p_made[i];
    }
}
