use super::*;

/// Boxes of mixed sizes, in a place or in a plane, some of them equal.
fn boxes(random: &mut fastrand::Rng, count: usize, size: f64, flat: bool) -> Vec<Span> {
    let mut of =
        |size: f64| DVec3::from_array(std::array::from_fn(|axis| if flat && axis == 1 { 0.0 } else { size * random.f64() }));
    let mut boxes: Vec<Span> =
        (0..count).map(|_| of(1.0)).collect::<Vec<_>>().into_iter().map(|low| [low, low + of(size)]).collect();
    boxes.extend_from_within(..count / 10);
    boxes
}

/// Each overlapping pair is found once, as by comparing all.
#[test]
fn all_overlaps_are_found_once() {
    let mut random = fastrand::Rng::with_seed(1);
    for (case, size) in (0..40).zip([0.0, 0.02, 0.1, 0.5, 3.0].into_iter().cycle()) {
        // The larger lists are worth several threads.
        let counts = if case % 8 < 2 { [900, 700] } else { [300, 200] };
        let lists = counts.map(|count| boxes(&mut random, count, size, case % 3 == 0));
        let [one, other] = if case % 4 == 0 { [lists[0].clone(), lists[0].clone()] } else { lists };
        let mut found = overlaps(&one, &other, &mut { usize::MAX }, case % 2 == 0, &|_, _| true);
        found.sort_unstable();
        let all = (0..one.len()).flat_map(|a| (0..other.len()).map(move |b| [a as u32, b as u32]));
        let expected: Vec<_> = all.filter(|&[a, b]| overlap(&one[a as usize], &other[b as usize])).collect();
        assert_eq!(found, expected, "case {case}");
    }
}

#[test]
fn the_search_ends_when_its_room_is_used_up() {
    let one = vec![[DVec3::ZERO, DVec3::ONE]; 100];
    let mut room = 1000;
    let found = overlaps(&one, &one, &mut room, false, &|_, _| true).len();
    assert_eq!([room, found], [0, 1000]);
}
