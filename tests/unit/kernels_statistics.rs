//! Histogram classes and quantiles, compared with sorting.

use super::*;

/// A fixed sequence of evenly distributed numbers.
fn numbers(count: u32) -> impl Iterator<Item = f32> {
    (0..count).map(|k| (k as f32 * 0.618_034).fract())
}

#[test]
fn classes_are_in_order_and_an_eighth_of_an_octave_wide() {
    for least in [MIN_STRETCH, MIN_SPEED] {
        assert_eq!(class_of(0.0, least), 0);
        assert_eq!(class_of(0.999 * least, least), 0);
        assert_eq!(class_of(least, least), 1);
        assert_eq!(class_of(2.0 * least, least), 9);
        assert_eq!(class_of(f32::MAX, least), CLASSES - 1);
        for class in 1..CLASSES - 1 {
            let [low, high] = [begin(class, least), begin(class + 1, least)];
            assert!(high / low <= 1.13 && [low, 0.999 * high].iter().all(|&value| class_of(value, least) == class));
        }
    }
}

#[test]
fn a_share_is_that_of_plain_sorting() {
    let stretches: Vec<f32> = numbers(10_000).map(|x| 0.3 * x * x * x).collect();
    let mut seen = Statistics::default();
    stretches.iter().for_each(|&stretch| seen.stretch[class_of(stretch, MIN_STRETCH)] += WHOLE / 10_000);
    seen.worst_stretch = stretches.iter().copied().fold(0.0, f32::max).to_bits();
    let mut sorted = stretches;
    sorted.sort_unstable_by(f32::total_cmp);
    for share in [0.5, 0.9, 0.99, 0.999, 1.0] {
        let plain = sorted[((share * 10_000.0) as usize).min(9_999)];
        let told = seen.stretch_of(share);
        assert!((told / plain - 1.0).abs() < 0.07, "{share}: {told}, sorted {plain}");
    }
}

#[test]
fn ordered_numbers_are_in_the_order_of_the_values() {
    let mut values: Vec<f32> = numbers(1000).flat_map(|x| [x - 0.5, 1e6 * (x - 0.5), 0.0, f32::MAX, f32::MIN]).collect();
    values.sort_unstable_by(f32::total_cmp);
    assert!(values.windows(2).all(|pair| ordered(pair[0]) <= ordered(pair[1])));
    for &value in &values {
        assert_eq!(unordered([ordered(value); 3]), Vec3::splat(value));
    }
}

/// Of vertices of which half move at 1 m/s, and of slow ones.
#[test]
fn the_mean_speed_counts_what_moves_fast() {
    let mut half = Statistics { slow: 50 * SLOW_PARTS as u32, fastest: 1.0_f32.to_bits(), ..Statistics::default() };
    (half.speed[0], half.speed[class_of(1.0, MIN_SPEED)]) = (50, 50);
    let expected = 0.5_f32.sqrt();
    assert!((half.rms_speed() / expected - 1.0).abs() < 0.13, "{} m/s", half.rms_speed());
    let mut slow = Statistics { slow: SLOW_PARTS as u32, fastest: (0.5 * SLOW).to_bits(), ..Statistics::default() };
    slow.speed[class_of(0.5 * SLOW, MIN_SPEED)] = 4;
    assert!((slow.rms_speed() - 0.5 * SLOW).abs() < 1e-6, "{} m/s", slow.rms_speed());
}
