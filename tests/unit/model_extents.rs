//! How far cloths span between what holds them.

use crate::model::cloth::Cloth;
use crate::{Mesh, Options};

use super::*;

fn extents_of(mesh: &Mesh, pinned: &[u32]) -> Extents {
    Cloth::new(mesh, &Options { pinned: pinned.to_vec(), ..Options::default() }).unwrap().extents
}

fn assert_near(found: Extents, sides: [f64; 3], extent: f64) {
    let apart = (found.sides - DVec3::from(sides)).abs().max_element().max((found.extent - extent).abs());
    assert!(apart < 1e-5, "{found:?}, not {sides:?} and {extent}");
}

#[test]
fn a_cloth_spans_no_more_than_twice_the_way_to_its_pins() {
    let sheet = Mesh::grid(21, 11, 2.0, 1.0);
    assert_near(extents_of(&sheet, &[]), [2.0, 0.0, 1.0], 2.0);
    // By a long side, along its middle, and by a short side.
    assert_near(extents_of(&sheet, &(0..21).collect::<Vec<u32>>()), [2.0, 0.0, 1.0], 2.0);
    assert_near(extents_of(&sheet, &(105..126).collect::<Vec<u32>>()), [1.0, 0.0, 1.0], 1.0);
    assert_near(extents_of(&sheet, &(0..11).map(|row| 21 * row).collect::<Vec<u32>>()), [2.0, 0.0, 1.0], 2.0);
    // By one corner: no more than across.
    assert_near(extents_of(&sheet, &[0]), [2.0, 0.0, 1.0], 2.0);
}

#[test]
fn cloths_that_share_a_mesh_reach_as_far_as_each() {
    let one = Mesh::grid(11, 11, 1.0, 1.0);
    let mut both = one.clone();
    both.positions.extend(one.positions.iter().map(|x| *x + Vec3::X * 100.0));
    both.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + 121)));
    assert_near(extents_of(&both, &[]), [1.0, 0.0, 1.0], 1.0);
    assert_eq!([extents_of(&one, &[]), extents_of(&both, &[])].map(|found| found.parts), [1, 2]);
    // One that is not pinned counts as a whole, and one that is pinned everywhere not at all.
    let hung: Vec<u32> = (0..121).collect();
    assert_near(extents_of(&one, &hung), [0.0, 0.0, 0.0], 0.0);
    assert_near(extents_of(&both, &hung), [1.0, 0.0, 1.0], 1.0);
}

#[test]
fn a_wide_curtain_on_hooks_is_as_high_as_a_narrow_one() {
    let curtain = Mesh::grid(401, 11, 40.0, 1.0);
    let hooks: Vec<u32> = (0..401).step_by(10).collect();
    let found = extents_of(&curtain, &hooks);
    assert!((2.0..3.2).contains(&found.extent) && found.sides.z > 0.999, "{found:?}");
}

/// A hundredth of a square sheet lies in a quarter of a circle about one corner, in two about two, in a strip along an edge.
#[test]
fn how_far_a_hundredth_of_the_cloth_is_from_its_pins() {
    let n = 101;
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let near = |pinned: &[u32]| extents_of(&mesh, pinned).near;
    let circle = |quarters: f64| (0.04 / (std::f64::consts::PI * quarters)).sqrt();
    // Ways along edges are longer than straight ones, by up to 41 % across the diagonals.
    for (pinned, exact) in [(vec![0], circle(1.0)), (vec![0, n - 1], circle(2.0)), (vec![n * n / 2], circle(4.0))] {
        assert!((0.95..1.2).contains(&(near(&pinned) / exact)), "{pinned:?}: {} m, {exact} m", near(&pinned));
    }
    assert!((near(&(0..n).collect::<Vec<_>>()) - 0.01).abs() < 1e-6 && near(&[]) == 0.0);
}

/// Of cloths that share a mesh each counts by itself: one among fifty that are free is not half of it near its pin.
#[test]
fn each_part_has_a_hundredth_of_its_own() {
    let (n, sheet) = (11, Mesh::grid(11, 11, 1.0, 1.0));
    let mut many = Mesh::default();
    for part in 0..50_u32 {
        many.positions.extend(sheet.positions.iter().map(|&x| x + Vec3::X * 2.0 * part as f32));
        many.triangles.extend(sheet.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + part * n * n)));
    }
    let alone = extents_of(&sheet, &[0]).near;
    assert!(alone > 0.0 && extents_of(&many, &[0]).near == alone, "{} m, {alone} m", extents_of(&many, &[0]).near);
}
