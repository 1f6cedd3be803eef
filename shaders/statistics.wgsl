// Statistics of a state: how far the cloth's area is stretched, and how fast its vertices move. All sums are of
// integers, so they do not depend on the order of summation. The constants are explained in src/kernels/statistics.rs.

const CLASSES: u32 = 128u;
const BITS: u32 = 20u;
const MIN_STRETCH: f32 = 0.000244140625;
const MIN_SPEED: f32 = 0.0009765625;
const WHOLE: u32 = 1073741824u;
const ONE: f32 = 67108864.0;
const MAX_STRETCH: f32 = 32.0;
const SLOW: f32 = 0.01;
const SLOW_PARTS: f32 = 128.0;
const CRUSHED: f32 = 0.97;

struct StrainGauge {
    ends: vec2u,
    inverse_rest: f32,
    weight: u32,
}

struct Statistics {
    stretch: array<atomic<u32>, CLASSES>,
    speed: array<atomic<u32>, CLASSES>,
    mean_stretch: atomic<u32>,
    worst_stretch: atomic<u32>,
    slow: atomic<u32>,
    fastest: atomic<u32>,
    low: array<atomic<u32>, 3>,
    high: array<atomic<u32>, 3>,
    crushed: atomic<u32>,
}

// The class of a stretch or a speed: eight classes per octave from `least` on, formed from the leading bits of the
// number.
fn class_of(value: f32, least: f32) -> u32 {
    let before = (bitcast<u32>(least) >> BITS) - 1u;
    return min(max(bitcast<u32>(value) >> BITS, before) - before, CLASSES - 1u);
}

// The stretch of an edge with this length [m]; 0 if it is compressed.
fn stretch(length: f32, inverse_rest: f32) -> f32 {
    return max(length * inverse_rest, 1.0) - 1.0;
}

// Whether an edge with this length [m] is crushed.
fn is_crushed(length: f32, inverse_rest: f32) -> bool {
    return length * inverse_rest < CRUSHED;
}

// Maps a number to an integer so that integers are ordered like the numbers.
fn ordered(value: f32) -> u32 {
    let bits = bitcast<u32>(value);
    return select(bits | 0x80000000u, ~bits, (bits >> 31u) == 1u);
}
