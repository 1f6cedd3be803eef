//! Triangles without area are left out, and those beside them are split.

use glam::Vec4;

use super::without_caps;

/// Five points on a line, and one on either side of it.
fn rest() -> Vec<Vec4> {
    let on_line = (0..5).map(|x| Vec4::new(x as f32, 0.0, 0.0, 1.0));
    on_line.chain([Vec4::new(2.0, 0.0, 3.0, 1.0), Vec4::new(2.0, 0.0, -3.0, 1.0)]).collect()
}

fn sorted(mut triangles: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    triangles.sort_unstable();
    triangles
}

#[test]
fn what_is_beside_a_cap_is_split_at_its_corner() {
    let mesh = [[0, 4, 5], [0, 2, 4], [2, 0, 6], [4, 2, 6]];
    assert_eq!(sorted(without_caps(&mesh, &rest(), 1e-6)), [[0, 2, 5], [2, 0, 6], [2, 4, 5], [4, 2, 6]]);
}

#[test]
fn a_chain_of_caps_splits_at_each_corner() {
    let mesh = [[0, 4, 5], [4, 0, 1], [1, 2, 4], [2, 3, 4]];
    assert_eq!(sorted(without_caps(&mesh, &rest(), 1e-6)), [[0, 1, 5], [1, 2, 5], [2, 3, 5], [3, 4, 5]]);
}

/// Between the sides of a quad without area, both ways around.
#[test]
fn caps_on_the_same_side_split_each_others_halves() {
    let mesh = [[0, 4, 1], [4, 0, 3], [0, 1, 5], [1, 4, 5], [3, 0, 6], [4, 3, 6]];
    let split = [[0, 1, 5], [1, 0, 6], [1, 3, 5], [3, 1, 6], [3, 4, 5], [4, 3, 6]];
    assert_eq!(sorted(without_caps(&mesh, &rest(), 1e-6)), split);
}

#[test]
fn a_cap_at_a_border_vanishes_and_others_are_left() {
    assert_eq!(without_caps(&[[0, 4, 2]], &rest(), 1e-6), [[0; 3]; 0]);
    let proper = [[0, 4, 5], [4, 0, 6]];
    assert_eq!(without_caps(&proper, &rest(), 1e-6), proper);
    // Needles have no corner between the ends of a side.
    let mut rest = rest();
    rest[1] = rest[0];
    let needle = [[0, 1, 5], [0, 4, 5]];
    assert_eq!(without_caps(&needle, &rest, 1e-6), needle);
}

#[test]
fn very_many_splits_are_not_made() {
    let chain: Vec<Vec4> = (0..100).map(|x| Vec4::new(x as f32, 0.0, 0.0, 1.0)).collect();
    let apexes = (0..100).map(|k| Vec4::new(50.0, 10.0, k as f32, 1.0));
    let rest: Vec<Vec4> = chain.into_iter().chain(apexes).collect();
    let book = (100..200).map(|apex| [0, 99, apex]);
    let mesh: Vec<[u32; 3]> = book.chain((0..98).map(|k| [k, k + 1, 99])).collect();
    assert_eq!(without_caps(&mesh, &rest, 1e-6), mesh);
}
