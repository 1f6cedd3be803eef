// Reductions over all vertices: the mean displacement, or the middle of the range of the kinematic ones, from the
// workgroups' parts (`Part` of `shared.wgsl`), and with the same sums what truncation takes from free cloth.

var<workgroup> low: array<vec4f, WORKGROUP>;
var<workgroup> high: array<vec4f, WORKGROUP>;

fn nothing() -> Part {
    if is_free() {
        return Part();
    }
    return Part(vec4f(MAX_POSITION), vec4f(-MAX_POSITION));
}

fn both(a: Part, b: Part) -> Part {
    if is_free() {
        return Part(a.low + b.low, vec4f());
    }
    return Part(min(a.low, b.low), max(a.high, b.high));
}

// Reduces the parts of a workgroup's invocations to the first, in a fixed order.
fn gather(part: Part, lane: u32) {
    low[lane] = part.low;
    high[lane] = part.high;
    for (var width = WORKGROUP / 2u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if lane < width {
            let one = both(Part(low[lane], high[lane]), Part(low[lane + width], high[lane + width]));
            low[lane] = one.low;
            high[lane] = one.high;
        }
    }
}

// Reduces the parts of a workgroup's invocations to one of `count` parts, which begin at place `first`.
fn store_part(part: Part, first: u32, count: u32, lane: u32, group: Workgroup) {
    gather(part, lane);
    let at = number_of(group);
    if lane == 0u && at < count {
        contact_state.parts[first + at] = Part(low[0], high[0]);
    }
}

// Every workgroup that calls this reduces all parts by itself, in the same order.
fn mean_of_parts(lane: u32) -> vec3f {
    var part = nothing();
    // The mean is that of the cloth.
    let count = contact_params.groups + select(contact_params.mesh_groups, 0u, is_free());
    for (var k = lane; k < count; k += WORKGROUP) {
        part = both(part, contact_state.parts[k]);
    }
    gather(part, lane);
    workgroupBarrier();
    if is_free() {
        return low[0].xyz / low[0].w;
    }
    // If kinematic vertices move differently by more than this, there is no common motion: the mean would also move
    // cloth that follows neither.
    let is_common = distance(low[0].xyz, high[0].xyz) < contact_params.thickness;
    return select(vec3f(), 0.5 * (low[0].xyz + high[0].xyz), is_common);
}
