//! Unit tests of `src/step/motion.rs`.

use std::mem::discriminant;

use glam::Vec3;

use super::{Motion, are_in_order};
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

/// One that is put elsewhere says nothing about the order of the others.
#[test]
fn a_teleported_collider_leaves_the_others_their_motion() {
    let ball = |x: f32| Collider::sphere(Vec3::X * x, 0.1);
    let (last, now) = ([ball(0.0), ball(10.0)], [ball(0.03), ball(0.01).teleported()]);
    let motion = Motion { colliders: last.to_vec(), ..Motion::default() };
    let from: Vec<&Collider> = motion.followed(&now).map(|(_, from)| from).collect();
    assert_eq!(from, [&last[0], &now[1]]);
    assert!(!are_in_order(last.iter(), [ball(0.03), ball(0.01)].iter()), "without a word they may have changed places");
}

/// Whether some two of a kind would have moved less if each were the other: every pair compared with every other.
fn some_exchange_is_shorter(last: &[Collider], now: &[Collider]) -> bool {
    let distance =
        |a: usize, b: usize| -> f32 { last[a].landmarks().into_iter().zip(now[b].landmarks()).map(|(a, b)| a.distance(b)).sum() };
    let is_kind = |a: usize, b: usize| discriminant(&last[a].shape) == discriminant(&last[b].shape);
    let moved: Vec<usize> = (0..last.len()).filter(|&index| distance(index, index) > 0.0).collect();
    let pairs = moved.iter().flat_map(|&a| moved.iter().map(move |&b| (a, b)));
    pairs
        .filter(|&(a, b)| a < b && is_kind(a, b))
        .any(|(a, b)| distance(a, b) + distance(b, a) < 0.999 * (distance(a, a) + distance(b, b)))
}

/// Colliders that move by about their distance are matched by their order in some cases and not in others, as a comparison of
/// all pairs says.
#[test]
fn order_is_what_all_pairs_say() {
    let mut random = fastrand::Rng::with_seed(1);
    let mut in_order = 0;
    for case in 0..2000 {
        let mut vector = |size: f32| Vec3::from_array([0; 3].map(|_| size * (2.0 * random.f32() - 1.0)));
        let far = if case % 3 == 0 { 1e5 } else { 0.0 };
        let make = |at: Vec3, k: usize| match k % 3 {
            0 => Collider::sphere(at, 0.1),
            1 => Collider::capsule(at, at + Vec3::Y, 0.1),
            _ => Collider::plane(at, Vec3::Y),
        };
        let places: Vec<Vec3> = (0..12).map(|_| vector(1.0) + far).collect();
        let by = [0.0, 0.05, 0.15, 0.3, 1.0][case % 5];
        let last: Vec<Collider> = places.iter().enumerate().map(|(k, at)| make(*at, k)).collect();
        let now: Vec<Collider> = places.iter().enumerate().map(|(k, at)| make(*at + vector(by), k)).collect();
        let is_in_order = are_in_order(last.iter(), now.iter());
        assert_eq!(is_in_order, !some_exchange_is_shorter(&last, &now), "case {case}, by {by} m");
        in_order += usize::from(is_in_order && by > 0.0);
    }
    println!("{in_order} of 1600 in order");
    assert!((200..1400).contains(&in_order), "{in_order} of 1600 in order");
}

/// A hundred thousand that move a little are matched, which takes minutes if all pairs are compared.
#[test]
fn many_colliders_are_matched() {
    let row = |by: f32| (0..100_000_u32).map(move |k| Collider::sphere(Vec3::X * (0.3 * k as f32 + by), 0.1)).collect::<Vec<_>>();
    assert!(are_in_order(row(0.0).iter(), row(0.125).iter()));
    // With ids, some of them gone from the list.
    let named = |by: f32| row(by).into_iter().zip(7..).map(|(collider, id)| collider.with_id(id)).collect::<Vec<_>>();
    let motion = Motion { colliders: named(0.0), ..Motion::default() };
    let now: Vec<Collider> = named(0.125).into_iter().filter(|now| now.id.is_some_and(|id| id % 1000 != 0)).collect();
    assert!(motion.followed(&now).all(|(now, last)| now.id == last.id && now.shape != last.shape));
    assert!(motion.check(&now).is_ok());
}
