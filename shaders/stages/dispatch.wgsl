// How an invocation finds its item, and types for lists of items.

// One row of a compressed sparse row list: items `start` up to but not including `end`.
struct Span {
    start: u32,
    end: u32,
}

// A range of items that one dispatch processes.
struct Batch {
    first: u32,
    count: u32,
}

const WORKGROUP: u32 = 64u;

// Large dispatches are folded into two dimensions, because one dimension is limited to 65535 workgroups.
fn item(id: vec3u, groups: vec3u) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}
