// The unit vector along `sum`, or 0 if there is no area. Scaled before it is normalized, because squares of small areas
// would underflow.
fn unit(sum: vec3f) -> vec3f {
    let largest = max(max(abs(sum.x), abs(sum.y)), abs(sum.z));
    if largest < 1e-30 {
        return vec3f();
    }
    return normalize(sum / largest);
}
