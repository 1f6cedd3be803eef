//! The common motion: a rigid one, fitted to the motion of some points.

use glam::{Quat, Vec3, Vec3A};

use super::CommonMotion;

fn vector(random: &mut fastrand::Rng, size: f32) -> Vec3A {
    Vec3A::from_array(std::array::from_fn(|_| size * (2.0 * random.f32() - 1.0)))
}

/// Points that turn by up to a fifth of a radian and move on: the motion moves each as it moves, and so do distances of other
/// points not change.
#[test]
fn the_rigid_motion_of_points_is_found() {
    let mut random = fastrand::Rng::with_seed(3);
    for count in [2, 3, 4, 50] {
        for _ in 0..20 {
            let (spin, shift, at) = (vector(&mut random, 0.11), vector(&mut random, 0.01), vector(&mut random, 1.0));
            let turn = Quat::from_scaled_axis(Vec3::from(spin));
            let points: Vec<Vec3A> = (0..count).map(|_| at + vector(&mut random, 0.3)).collect();
            let by = |x: Vec3A| turn * (x - at) + at + shift - x;
            let motion = CommonMotion::turning(points.iter().map(|&x| (x, by(x))));
            // Two points do not tell how they turn about the line between them, which adds to how they seem to move.
            let most = if count == 2 { 0.003 } else { 2e-4 };
            for &x in &points {
                assert!(motion.at(x).distance(by(x)) < most, "{count} points: {} is not {}", motion.at(x), by(x));
            }
            let (a, b) = (vector(&mut random, 1.0), vector(&mut random, 1.0));
            let stretched = (a + motion.at(a)).distance(b + motion.at(b)) - a.distance(b);
            assert!(stretched.abs() < 1e-6, "{stretched}");
            let turned = motion.at(a) - motion.at(b);
            assert!((motion.back(turned + a - b) - (a - b)).length() < 1e-6);
        }
    }
}

/// A translation is found exactly, and points in one place or in a line, which do not tell how they turn, give no nonsense.
#[test]
fn points_that_do_not_turn_have_no_turn() {
    let (by, line) = (Vec3A::new(0.01, -0.02, 0.005), Vec3A::new(0.1, 0.2, -0.05));
    for count in [1, 2, 10] {
        for apart in [0.0, 1.0] {
            let points = (0..count).map(|k| (line * (apart * k as f32), by));
            let motion = CommonMotion::turning(points);
            assert!(motion.at(Vec3A::ONE).distance(by) < 1e-7, "{count} points {apart} apart: {motion:?}");
        }
    }
    let torn = CommonMotion::turning([(Vec3A::ONE, by), (Vec3A::ONE, -by)].into_iter());
    assert!(torn.at(Vec3A::X).length() < 1e-7, "{torn:?}");
}

/// Also not the motion that stands for none: a matrix is the identity by default, not zero.
#[test]
fn no_motion_moves_nothing() {
    let x = Vec3A::new(1.0, -2.0, 0.5);
    assert_eq!([CommonMotion::default().at(x), CommonMotion::default().back(x)], [Vec3A::ZERO, x]);
}

/// Kinematic points that rotate have a common motion however many they are, of which some are fitted. What only moves along has
/// none, and neither has what turns in two ways.
#[test]
fn what_turns_as_one_has_a_common_motion() {
    let (mut random, shift, thickness) = (fastrand::Rng::with_seed(5), Vec3A::new(0.002, 0.0, -0.001), 0.005);
    for count in [3, 64, 1000] {
        let points: Vec<Vec3A> = (0..count).map(|_| vector(&mut random, 0.3)).collect();
        let led = |turn: &dyn Fn(usize) -> f32| {
            let by = |(k, &x): (usize, &Vec3A)| (x, Quat::from_rotation_y(turn(k)) * x + shift - x);
            points.iter().enumerate().map(by).collect::<Vec<_>>()
        };
        let turning = led(&|_| 0.002);
        let motion = CommonMotion::of_kinematic(turning.iter().copied(), thickness).expect("they turn");
        assert!(turning.iter().all(|&(x, u)| motion.at(x).distance(u) < 1e-6), "{count} points");
        assert_eq!(CommonMotion::of_kinematic(led(&|_| 0.0).into_iter(), thickness), None, "{count} points move along");
        let both = led(&|k| if k % 2 == 0 { 0.002 } else { -0.002 });
        assert_eq!(CommonMotion::of_kinematic(both.into_iter(), thickness), None, "{count} points turn in two ways");
    }
    assert_eq!(CommonMotion::of_kinematic(std::iter::empty(), thickness), None);
}
