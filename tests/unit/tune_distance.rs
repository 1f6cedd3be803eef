//! Unit tests of `src/tune/distance.rs`.

use super::*;

fn look(positions: &[Vec3], speed: f64) -> ClipFrame {
    ClipFrame { positions: positions.to_vec(), speed }
}

#[test]
fn a_shift_is_as_far_by_vertices_as_by_spread() {
    let points: Vec<Vec3> = (0..50).map(|k| Vec3::new(k as f32, (k * k % 7) as f32, 0.0)).collect();
    let way = Vec3::new(0.3, -0.4, 1.2);
    let moved: Vec<Vec3> = points.iter().map(|x| *x + way).collect();
    assert!((rms(&points, &moved) - 1.3).abs() < 1e-5);
    assert!((spread(&look(&points, 0.0), &look(&moved, 0.0)) - 1.3).abs() < 1e-5);
}

#[test]
fn the_spread_does_not_ask_which_vertex_is_where() {
    let points: Vec<Vec3> = (0..50).map(|k| Vec3::new(k as f32, 0.0, 0.0)).collect();
    let turned: Vec<Vec3> = points.iter().rev().copied().collect();
    assert!(rms(&points, &turned) > 10.0);
    assert_eq!(spread(&look(&points, 1.0), &look(&turned, 1.0)), 0.0);
    // A difference of 2 m/s in speed counts like a distance of .2 m.
    assert!((spread(&look(&points, 1.0), &look(&turned, 3.0)) - 0.2).abs() < 1e-9);
}
