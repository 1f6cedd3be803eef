// What an aggregate of a coarse level is averaged to: its center and its inverse mass, and its predicted displacement.
struct Average {
    x: vec4f,
    u: vec4f,
}
