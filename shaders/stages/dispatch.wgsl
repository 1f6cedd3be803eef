// How an invocation finds its item, and lists of items.

// Items from `start` up to `end`: those of one row of many (compressed sparse rows).
struct Span {
    start: u32,
    end: u32,
}

// A run of items for one dispatch.
struct Batch {
    first: u32,
    count: u32,
}

const WORKGROUP: u32 = 64u;

// Large dispatches are folded into two dimensions: one holds 65535 workgroups.
fn item(id: vec3u, groups: vec3u) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}
