// The intermediate vectors of bending in workgroup memory (see bend_ring.wgsl), for vertices that a tile has moments of.

// Vertices with moments that a tile has room for, and numbers of all their vectors.
override BENT: u32 = 64u;
override MOMENTS: u32 = 384u;

var<workgroup> moments: array<f32, MOMENTS>;

fn bend_room() -> u32 {
    return BENT;
}

fn bend_vector(at: u32) -> vec3f {
    return vec3f(moments[3u * at], moments[3u * at + 1u], moments[3u * at + 2u]);
}

fn set_bend_vector(at: u32, value: vec3f) {
    moments[3u * at] = value.x;
    moments[3u * at + 1u] = value.y;
    moments[3u * at + 2u] = value.z;
}
