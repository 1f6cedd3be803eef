// The part of the watch that measures edges, from a table of colored edges. The including shader defines where the vertex
// at a place of the tile is (`position_at`).

// The edges of one color of a tile, in the next step those of the next color. `mark` says which table it is. An edge
// without stiffness holds nothing together.
fn check_edges(tile: u32, mark: u32, lane: u32) {
    // A cloth without edges has no colors, and no width.
    let color = found.steps % max(COLORS, 1u);
    for (var k = lane; k < WIDTH; k += LANES) {
        let stored = fetch(edges_of(tile), color, k);
        if stored.ends == NONE || bitcast<f32>(stored.inverse_weight) == 0.0 {
            continue;
        }
        if is_long(position_at(stored.ends & 0xffffu) - position_at(stored.ends >> 16u)) {
            atomicMin(&found.long, mark | ((tile * COLORS + color) * WIDTH + k));
        }
    }
}
