//! The closest points of a pair and its multipliers, compared with their definitions.

use glam::DVec3;

use super::{Kind, closest, edge_edge, held_distance, impulse, perpendicular, separation, step_of_lambda, vertex_triangle};
use crate::simd::Vector;

fn lanes(x: [DVec3; 4]) -> [Vector<f32>; 4] {
    x.map(|x| Vector::new(x.x as f32, x.y as f32, x.z as f32))
}

fn distance(weights: [f64; 4], x: [DVec3; 4]) -> f64 {
    weights.iter().zip(x).map(|(&weight, x)| x * weight).sum::<DVec3>().length()
}

/// Distance of a point from a segment.
fn to_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let t = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-300)).clamp(0.0, 1.0);
    p.distance(a + (b - a) * t)
}

/// The minimum of a function over 0..1, searched near the least of a hundred samples.
fn least(of: impl Fn(f64) -> f64) -> f64 {
    let coarse = (0..=100).map(|k| f64::from(k) / 100.0).min_by(|&a, &b| of(a).total_cmp(&of(b))).unwrap();
    let (mut low, mut high) = ((coarse - 0.01).max(0.0), (coarse + 0.01).min(1.0));
    for _ in 0..100 {
        let third = (high - low) / 3.0;
        if of(low + third) < of(high - third) { high -= third } else { low += third }
    }
    of(0.5 * (low + high))
}

/// Four corners about a unit apart, sometimes with two of them, or all, on a line or in one place.
fn corners(random: &mut fastrand::Rng) -> [DVec3; 4] {
    let mut point = || DVec3::new(random.f64(), random.f64(), random.f64());
    let mut x = [point(), point(), point(), point()];
    match random.u32(0..12) {
        0 => x[3] = x[2],
        1 => x[1] = x[0],
        2 => x[3] = x[2] + (x[1] - x[0]),
        3 => x[3] = x[1] * 0.3 + x[2] * 0.7,
        4 => x[2] = x[1],
        5 => x[3] = x[1],
        _ => {}
    }
    x
}

#[test]
fn closest_points_are_the_closest() {
    let mut random = fastrand::Rng::with_seed(1);
    for _ in 0..3000 {
        let x = corners(&mut random);
        let [p, a, b, c] = x;
        let weights = vertex_triangle(lanes(x)).map(f64::from);
        let expected = least(|t| to_segment(p, a, b + (c - b) * t));
        assert!((distance(weights, x) - expected).abs() < 2e-6, "{x:?}: {weights:?} instead of {expected}");
        assert!(weights[0] == 1.0 && weights[1..].iter().all(|weight| (-1.0 - 1e-6..=1e-6).contains(weight)), "{weights:?}");
        assert!((weights.iter().sum::<f64>()).abs() < 1e-6, "{weights:?}");

        let weights = edge_edge(lanes(x)).map(f64::from);
        let expected = least(|t| to_segment(p + (a - p) * t, b, c));
        assert!((distance(weights, x) - expected).abs() < 5e-4 * (1.0 + expected), "{x:?}: {weights:?} instead of {expected}");
        assert!((weights[0] + weights[1] - 1.0).abs() < 1e-6 && (weights[2] + weights[3] + 1.0).abs() < 1e-6, "{weights:?}");
    }
}

/// Two masses approaching: one step with the exact rate stops the approach. If they move apart, nothing holds them.
#[test]
fn a_multiplier_ends_the_approach_and_never_pulls() {
    let (w, n) = (2.0_f32, Vector::new(0.0, 1.0, 0.0));
    let rate = 1.0 / (2.0 * w);
    let (zero, none) = (Vector::zero(), (Vector::<f32>::zero(), 0.0));
    let after = |relative: Vector<f32>, lambda| relative + impulse(lambda, n) * (2.0 * w);
    let pressed = Vector::new(0.0, -0.3, 0.0);
    let lambda = step_of_lambda(none, n, 0.1, pressed, rate, 0.0);
    assert!((after(pressed, lambda).y + 0.1).abs() < 1e-6, "up to the gap and no farther");
    let (lambda_t, lambda_n) = step_of_lambda(none, n, 0.1, zero - pressed, rate, 0.5);
    assert!(lambda_n == 0.0 && lambda_t.dot(lambda_t) == 0.0);
    // Coulomb: the friction multiplier is at most mu times the normal one, and opposes the slip.
    let slipping = Vector::new(5.0, -0.2, 0.0);
    let (lambda_t, lambda_n) = step_of_lambda(none, n, 0.0, slipping, rate, 0.5);
    assert!((lambda_t.x + 0.5 * lambda_n).abs() < 1e-6 && lambda_t.y == 0.0, "{lambda_t:?} of {lambda_n}");
    let creeping = Vector::new(0.01, -0.2, 0.0);
    let left = after(creeping, step_of_lambda(none, n, 0.0, creeping, rate, 0.5));
    assert!(left.dot(left) < 1e-12, "it sticks");
}

/// Between two plates that are closer than twice the thickness, equal corrections balance in the middle only, also if both are
/// limited; none is larger than the limit.
#[test]
fn corrections_balance_in_the_middle() {
    let (thickness, between) = (0.005_f32, 0.006);
    for most in [1e-4, 1e-3, 1e-2_f32] {
        for k in 0..=60 {
            let below = 1e-4 * k as f32;
            let push = |distance: f32| separation((thickness - distance).max(0.0), thickness, most);
            let (up, down) = (push(below), push(between - below));
            assert!(up <= most && down <= most, "{up} and {down} of {most}");
            let off = below - 0.5 * between;
            assert!(off.abs() < 1e-6 || (up - down) * off < 0.0, "{below} m above one: {up} up, {down} down");
        }
    }
}

/// Corners in two parallel planes, where kinematic ones of both sides touch: with the free ones of a side a thickness away from the
/// other side, the closest points are as far apart as they are held. Without kinematic corners on both sides it is the thickness.
#[test]
fn kinematic_corners_that_touch_are_not_held_apart() {
    let mut random = fastrand::Rng::with_seed(1);
    for k in 0..1000 {
        let (kind, thickness) = (Kind::ALL[k % 2], 0.005_f32);
        let [s, t] = [random.f32(), random.f32()];
        let weights = match kind {
            Kind::VertexTriangle => kind.weights(-s * t, -s * (1.0 - t)),
            Kind::EdgeEdge => kind.weights(s, -t),
        };
        let is_kinematic = [(); 4].map(|()| random.bool());
        let kinematic = [0, 1, 2, 3].map(|k| if is_kinematic[k] { weights[k] } else { 0.0 });
        // The sum of the free weights of a side, and so of the heights of these corners.
        let raised = |side: std::ops::Range<usize>| side.filter(|&k| !is_kinematic[k]).map(|k| weights[k].abs()).sum::<f32>();
        let by_either = [0..kind.first_side(), kind.first_side()..4].map(|side| thickness * raised(side));
        let (held, expected) = (held_distance(thickness, kinematic), by_either[0].max(by_either[1]));
        assert!((held - expected).abs() < 1e-6 * thickness, "{kind:?} {weights:?} {is_kinematic:?}: {held}, not {expected}");
        let all_free = [0.0; 4];
        assert_eq!(held_distance(thickness, all_free).to_bits(), thickness.to_bits());
    }
}

/// Features of 12 cm that nearly touch, half a meter from the origin: the direction between them is within the rounding
/// of positions over the length of an edge. The vector between their closest points is tilted by that rounding over their
/// distance, which over the length of an edge is more than the distance.
#[test]
fn the_direction_between_features_that_nearly_touch_separates_them() {
    let mut random = fastrand::Rng::with_seed(7);
    let mut worst = [0.0_f64; 2];
    for case in 0..400 {
        let kind = Kind::ALL[usize::from(case % 2 == 0)];
        let axis = DVec3::from_array([0; 3].map(|_| random.f64() - 0.5)).normalize();
        let (along, over) = (axis.any_orthonormal_vector(), axis.cross(axis.any_orthonormal_vector()));
        let at = DVec3::splat(0.5);
        let wide = |angle: f64| (along * angle.cos() + over * angle.sin()) * 0.12;
        let turn = random.f64();
        let exact = if kind == Kind::EdgeEdge {
            [at - wide(turn) * 0.4, at + wide(turn) * 0.6, at - wide(turn + 1.0) * 0.6, at + wide(turn + 1.0) * 0.4]
        } else {
            [at, at + wide(turn), at + wide(turn + 2.1), at + wide(turn + 4.2)]
        };
        let first_side = kind.first_side();
        let mut x = exact;
        x[..first_side].iter_mut().for_each(|x| *x += axis * 1e-5);
        // Directions are compared with those of the rounded positions.
        let rounded = lanes(x);
        let weights = closest(kind, rounded);
        let apart = (0..4).fold(Vector::zero(), |sum: Vector<f32>, k| sum + rounded[k] * weights[k]);
        let double = |v: Vector<f32>| DVec3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z));
        let [a, b, c, d] = rounded.map(double);
        let normal = if kind == Kind::EdgeEdge { (b - a).cross(d - c) } else { (c - b).cross(d - b) }.normalize();
        let tilt = |v: Vector<f32>| double(v).normalize().cross(normal).length();
        let exact = perpendicular(apart, weights, rounded, kind);
        worst = [worst[0].max(tilt(apart)), worst[1].max(tilt(exact))];
    }
    let [tilted, exact] = worst;
    assert!(exact * 0.12 < 1e-6, "{exact:e}");
    assert!(tilted * 0.12 > 1e-4, "the vector itself would do: {tilted:e}");
}

/// On a side of a triangle the direction is perpendicular to that side alone, at a corner it is the vector itself, and
/// parallel edges count as one direction.
#[test]
fn the_direction_is_perpendicular_to_the_corners_in_use_only() {
    let triangle = lanes([DVec3::new(0.5, -0.3, 0.4), DVec3::ZERO, DVec3::X, DVec3::Y]);
    let weights = vertex_triangle(triangle);
    assert_eq!(weights[3], 0.0);
    let part = perpendicular(Vector::new(0.1, -0.3, 0.4), weights, triangle, Kind::VertexTriangle);
    assert_eq!([part.x, part.y, part.z], [0.0, -0.3, 0.4]);
    let corner = perpendicular(Vector::new(-0.1, -0.3, 0.4), [1.0, -1.0, 0.0, 0.0], triangle, Kind::VertexTriangle);
    assert_eq!([corner.x, corner.y, corner.z], [-0.1, -0.3, 0.4]);
    let parallel = lanes([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Y + DVec3::X]);
    let part = perpendicular(Vector::new(0.1, -1.0, 0.2), [0.5, 0.5, -0.5, -0.5], parallel, Kind::EdgeEdge);
    assert_eq!([part.x, part.y, part.z], [0.0, -1.0, 0.2]);
}
