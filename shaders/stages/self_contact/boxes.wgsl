// Boxes around paths, and whether they come close within the substeps that detection covers.

// The box within which some vertices may stray, and the range of their displacements.
struct Box {
    low: vec3f,
    high: vec3f,
    step_low: vec3f,
    step_high: vec3f,
}

// Those of the triangles, followed by those of the edges.
@group(1) @binding(15) var<storage, read_write> boxes: array<Box>;

fn box_of_node(n: u32) -> Box {
    return Box(nodes[n].place_low, nodes[n].place_high, nodes[n].step_low, nodes[n].step_high);
}

fn are_apart(a: Box, b: Box) -> bool {
    let relative = max(max(a.step_high - b.step_low, b.step_high - a.step_low), vec3f());
    let gap = max(a.low - b.high, b.low - a.high);
    return any(gap > relative * (0.5 * known.status.ahead) + about.thickness);
}
