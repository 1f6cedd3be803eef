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

// What differs between the invocations of a workgroup, and what they have in common. These are two structs, because browsers
// take all members of one to differ if any does, and then refuse barriers after a branch on the others.
struct Invocation {
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) lane: u32,
}

struct Workgroup {
    @builtin(workgroup_id) id: vec3u,
    @builtin(num_workgroups) all: vec3u,
}

const WORKGROUP: u32 = 64u;
// No index: greater than all.
const NONE: u32 = 0xffffffffu;

// Large dispatches are folded into two dimensions, because one dimension is limited to 65535 workgroups.
fn item(id: vec3u, groups: vec3u) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}

// In the last row of a dispatch there may be workgroups without work, whose numbers are too large.
fn number_of(group: Workgroup) -> u32 {
    return group.id.x + group.id.y * group.all.x;
}
