// The shortest dispatch that a step could have: it reads an index, what that refers to, and writes.

@group(0) @binding(0) var<storage, read> indices: array<u32>;
@group(0) @binding(1) var<storage, read_write> before: array<vec4f>;
// The input of the next dispatch in a chain.
@group(0) @binding(2) var<storage, read_write> after: array<vec4f>;

@compute @workgroup_size(64)
fn chain(@builtin(local_invocation_index) lane: u32) {
    after[lane] = before[indices[lane] + lane] + vec4f(1.0);
}
