// The tethers of all vertices, behind all else in the table.

// Where they begin.
override TETHERS: u32 = 0u;

fn tether_of(v: u32) -> Tether {
    let at = TETHERS + 4u * v;
    return Tether(table[at], bitcast<f32>(table[at + 1u]), bitcast<f32>(table[at + 2u]), bitcast<f32>(table[at + 3u]));
}
