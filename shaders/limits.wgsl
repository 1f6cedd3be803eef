// Which numbers a state may hold.

// What the first vertex out of bounds is while there is none.
const NONE: u32 = 0xffffffffu;

// Farther out [m] squares soon overflow; NaN and infinity are farther still. Compared by its bits, in which magnitudes
// are ordered: a shader compiler may assume that no value is NaN.
const MAX_POSITION: f32 = 1e15;

fn is_bounded(v: vec3f) -> bool {
    return all((bitcast<vec3u>(v) & vec3u(0x7fffffffu)) <= vec3u(bitcast<u32>(MAX_POSITION)));
}
