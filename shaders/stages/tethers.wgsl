// The tethers of all vertices, stored at the end of the table.

// The word of the table where they begin.
override TETHERS: u32 = 0u;

fn tether_of(v: u32) -> Tether {
    let at = TETHERS + 4u * v;
    return Tether(table[at], bitcast<f32>(table[at + 1u]), bitcast<f32>(table[at + 2u]), bitcast<f32>(table[at + 3u]));
}
