// The range of numbers that a state may hold.

// Farther out [m], squares soon overflow. The comparison is of bits, which order magnitudes like integers and put
// infinity and NaN above all numbers; in a comparison of floats a shader compiler may assume that no value is NaN.
const MAX_POSITION: f32 = 1e15;

fn is_bounded(v: vec3f) -> bool {
    return all((bitcast<vec3u>(v) & vec3u(0x7fffffffu)) <= vec3u(bitcast<u32>(MAX_POSITION)));
}
