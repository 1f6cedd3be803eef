//! How far triangles tilt whose vertices stray, compared with the worst case in double precision.

use glam::{DVec3, Vec3A};

use super::{CONE_COSINE, in_one_cone, may_tilt, normals_on_path};

fn normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a).normalize()
}

/// The sine of the angle by which the normal turns if each vertex strays so far in the worst direction: the ends of the
/// longest side to one side of the triangle, and the corner opposite to the other.
fn most_tilt(x: [DVec3; 3], margin: f64) -> f64 {
    let before = normal(x);
    let tilts = (0..3).map(|corner| {
        let [apex, base, end] = [0, 1, 2].map(|k| x[(corner + k) % 3]);
        let along = (end - base).normalize();
        let up = (apex - base) - along * (apex - base).dot(along);
        // Perpendicular to where the height will be.
        let sine = (2.0 * margin / up.length()).min(1.0);
        let way = before * (1.0 - sine * sine).sqrt() - up.normalize() * sine;
        let after = normal([apex + way * margin, base - way * margin, end - way * margin]);
        before.cross(after).length()
    });
    tilts.fold(0.0, f64::max)
}

/// A triangle of some shape, down to slivers, a few centimeters long.
fn triangle(random: &mut fastrand::Rng) -> [DVec3; 3] {
    let mut direction = || DVec3::new(random.f64() - 0.5, random.f64() - 0.5, random.f64() - 0.5).normalize();
    let (at, along, aside) = (direction(), direction(), direction());
    [at, at + along * 0.04, at + along * 0.04 * random.f64() + aside * 0.03 * (0.02 + random.f64())]
}

#[test]
fn triangles_may_tilt_exactly_if_the_cone_leaves_less() {
    let (mut random, cone_cosine) = (fastrand::Rng::with_seed(1), f64::from(CONE_COSINE));
    for case in 0..1000 {
        let x = triangle(&mut random);
        let longest = (0..3).map(|k| x[k].distance(x[(k + 1) % 3])).fold(0.0, f64::max);
        let twice_area = (x[1] - x[0]).cross(x[2] - x[0]).length();
        let height = twice_area / longest;
        for (share, tilts) in [(0.98, false), (1.02, true)] {
            let margin = share * 0.5 * cone_cosine * height;
            assert_eq!(may_tilt(twice_area as f32, longest as f32, margin as f32), tilts, "case {case}: {share} of {height} m");
            assert_eq!(most_tilt(x, margin) > cone_cosine, tilts, "case {case}: {share} of {height} m");
            // No motion of vertices that stray no farther tilts it more.
            let mut moved = || DVec3::new(random.f64() - 0.5, random.f64() - 0.5, random.f64() - 0.5).normalize() * margin;
            let tilt = normal(x).cross(normal(x.map(|x| x + moved()))).length();
            assert!(tilt <= most_tilt(x, margin) + 1e-9, "case {case}: {tilt}");
        }
    }
}

/// A triangle that may tilt is in no cone, whether it is low at the start of its path or at the end.
#[test]
fn what_may_tilt_is_in_no_cone() {
    let flat = |height: f32| [Vec3A::ZERO, Vec3A::X * 0.03, Vec3A::new(0.01, 0.0, height)];
    let is_in_one_cone = |before, after, margin| in_one_cone(normals_on_path(flat(before), flat(after), margin));
    assert!(is_in_one_cone(0.02, 0.02, 0.006), "low enough straying");
    assert!(!is_in_one_cone(0.02, 0.02, 0.007), "it may tilt");
    assert!(!is_in_one_cone(0.02, 0.01, 0.006), "it may tilt at the end of its path");
    assert!(!is_in_one_cone(0.01, 0.02, 0.006), "it may tilt at the start of its path");
}

/// What is within a cone on its path is so at each moment of it, also where it turns there and back.
#[test]
fn normals_are_within_their_bounds_on_the_whole_path() {
    let mut random = fastrand::Rng::with_seed(2);
    let mut within = 0;
    for case in 0..100_000 {
        let (x, end) = (triangle(&mut random), triangle(&mut random));
        let single = |x: [DVec3; 3]| x.map(|at| (at - x[0]).as_vec3a());
        let bounds = normals_on_path(single(x), single(end), 0.0);
        if !in_one_cone(bounds) {
            continue;
        }
        within += 1;
        let axis = (bounds[0] + bounds[1]).as_dvec3().normalize();
        for k in 0..=20 {
            let moment = f64::from(k) / 20.0;
            let along = normal(std::array::from_fn(|k| x[k].lerp(end[k], moment))).dot(axis);
            assert!(along > f64::from(CONE_COSINE) - 1e-3, "case {case}, {moment} of the path: {along}");
        }
    }
    assert!(within > 1000, "only {within} are");
}
