//! Unit tests of `src/step/motion.rs`.

use glam::Vec3;

use super::Motion;
use crate::attributes::Collider;

/// A row of equal spheres without ids, displaced along the row.
fn row(by: f32) -> Vec<Collider> {
    (0..4_u8).map(|k| Collider::sphere(Vec3::X * (0.3 * f32::from(k) + by), 0.1)).collect()
}

/// Whether each collider is matched with the one of the same place in the last list.
fn are_matched(last: &[Collider], now: &[Collider]) -> bool {
    let motion = Motion { colliders: last.to_vec(), ..Motion::default() };
    motion.followed(now).zip(last).all(|((_, from), last)| from == last)
}

#[test]
fn a_row_that_moves_is_matched_by_its_order() {
    for by in [0.01, 0.15, 0.3, 0.31, 0.5, 1.7] {
        assert!(are_matched(&row(0.0), &row(by)), "by {by} m");
        assert!(are_matched(&row(0.0), &row(-by)), "by -{by} m");
    }
}

#[test]
fn another_order_is_not_taken_for_motion() {
    let last = row(0.0);
    for (by, turn) in [(0.0, 1), (0.0, 2), (0.02, 1), (-0.02, 3)] {
        let mut now = row(by);
        now.rotate_left(turn);
        let motion = Motion { colliders: last.clone(), ..Motion::default() };
        assert!(motion.followed(&now).all(|(now, from)| now == from), "rotated by {turn}, moved by {by} m");
    }
    let mut now = row(0.0);
    now.swap(0, 3);
    let motion = Motion { colliders: last, ..Motion::default() };
    assert!(motion.followed(&now).all(|(now, from)| now == from), "two changed places");
}
