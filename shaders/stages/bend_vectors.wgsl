// The intermediate vectors of bending in workgroup memory (see bend_ring.wgsl), for vertices that a tile has moments of.

// Vertices with moments that a tile has room for, and the number of all their vectors.
override BENT: u32 = 64u;
override MOMENTS: u32 = 128u;

// Arrays of three numbers are not padded to four as vectors are.
var<workgroup> moments: array<array<f32, 3>, MOMENTS>;

fn bend_room() -> u32 {
    return BENT;
}

fn bend_vector(at: u32) -> vec3f {
    let numbers = moments[at];
    return vec3f(numbers[0], numbers[1], numbers[2]);
}

fn set_bend_vector(at: u32, value: vec3f) {
    moments[at] = array<f32, 3>(value.x, value.y, value.z);
}
