//! Planes between the sides of pairs, compared with their definitions.

use glam::{DVec3, Vec3A};

use super::{Plane, SEPARATES, SLIDING, clearance, excess, share_above};
use crate::kernels::pair::{Kind, closest};
use crate::simd::Vector;

type Four = [DVec3; 4];

fn lanes(x: Four) -> [Vector<f32>; 4] {
    x.map(|x| Vector::new(x.x as f32, x.y as f32, x.z as f32))
}

/// The plane across the vector between the closest points, and their distance.
fn across(x: Four, kind: Kind) -> (Plane<f32>, f32) {
    let x = lanes(x);
    let weights = closest(kind, x);
    let apart = (0..4).fold(Vector::zero(), |sum: Vector<f32>, k| sum + x[k] * weights[k]);
    let distance = apart.length();
    (Plane::halfway(apart * (1.0 / distance), x, 0.005, kind), distance)
}

/// The heights above the plane where corners have moved by what is left of their displacements, in double precision.
fn ends(x: Four, u: Four, plane: &Plane<f32>, shares: [f32; 4], kind: Kind) -> [f64; 4] {
    let normal = DVec3::new(f64::from(plane.normal.x), f64::from(plane.normal.y), f64::from(plane.normal.z));
    std::array::from_fn(|k| {
        let side = if k == 0 || (k == 1 && kind == Kind::EdgeEdge) { 1.0 } else { -1.0 };
        // The first corner's height says where the plane is.
        let start = f64::from(plane.heights[0]) + normal.dot(x[k] - x[0]);
        side * (start + normal.dot(u[k]) * f64::from(shares[k]))
    })
}

/// Whatever plane is chosen, no corner crosses it, it shortens no more than the one across the closest points, and it keeps the sides
/// apart at the start.
#[test]
fn the_plane_that_shortens_least_separates_the_sides() {
    let mut random = fastrand::Rng::with_seed(3);
    let mut replaced = 0;
    for case in 0..4000 {
        let kind = Kind::ALL[usize::from(case % 2 == 0)];
        let mut point = |size: f64| DVec3::new(random.f64() - 0.5, 0.1 * (random.f64() - 0.5), random.f64() - 0.5) * size;
        let mut x = [(); 4].map(|()| point(0.04));
        x[0].y += 0.01;
        x[1].y += if kind == Kind::EdgeEdge { 0.01 } else { 0.0 };
        let u = [(); 4].map(|()| point(0.04));
        let (plane, distance) = across(x, kind);
        let none = [0.0; 4];
        let before = plane.hold(lanes(u), none, 0.005, kind);
        let held = plane.least_shortening(before, lanes(x), (lanes(u), none), 0.005, kind);
        // Nothing is kinematic, so it is where it was.
        let chosen = held.plane;
        replaced += usize::from(chosen.normal.dot(plane.normal) < 0.999);
        assert!(held.least_share() >= before.least_share());
        assert!(chosen.gap(kind) > 0.999 * SEPARATES * distance, "{} m of {distance}", chosen.gap(kind));
        let start = ends(x, [DVec3::ZERO; 4], &chosen, [1.0; 4], kind);
        let end = ends(x, u, &chosen, held.shares, kind);
        let least = 0.999 * f64::from(chosen.clearance) - 1e-8;
        assert!(start.iter().chain(&end).all(|&height| height > least), "{start:?} to {end:?}, clearance {least}");
    }
    assert!(replaced > 400, "{replaced} planes were replaced");
}

/// A vertex slides over a flat triangle that it is beside, and an edge over a parallel one, by ten times their distance: nothing
/// holds them back, while the plane across their closest points leaves less than half. One that moves straight at the side of a
/// triangle of the same height is held as before.
#[test]
fn what_slides_along_a_flat_surface_is_not_shortened() {
    let beside =
        [DVec3::new(0.004, 0.005, 0.003), DVec3::new(0.01, 0.0, -0.02), DVec3::new(0.03, 0.0, 0.0), DVec3::new(0.0, 0.0, 0.03)];
    let edges =
        [DVec3::new(0.0, 0.005, 0.0), DVec3::new(0.02, 0.005, 0.02), DVec3::new(0.004, 0.0, -0.01), DVec3::new(0.044, 0.0, 0.03)];
    for (x, kind) in [(beside, Kind::VertexTriangle), (edges, Kind::EdgeEdge)] {
        for turn in 0..12 {
            let (sin, cos) = f64::from(turn).sin_cos();
            let u = DVec3::new(0.05 * cos, 0.0, 0.05 * sin);
            let u = if kind == Kind::EdgeEdge {
                [u, u, DVec3::ZERO, DVec3::ZERO]
            } else {
                [u, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO]
            };
            let (plane, _) = across(x, kind);
            for kinematic in [[0.0; 4], [0.0, if kind == Kind::EdgeEdge { 0.0 } else { 1.0 }, 1.0, 1.0]] {
                let before = plane.hold(lanes(u), kinematic, 0.005, kind);
                let held = plane.least_shortening(before, lanes(x), (lanes(u), kinematic), 0.005, kind);
                assert!(held.least_share() == 1.0 && held.passed_by == 0.0, "{turn}, {kind:?}: {}", held.least_share());
                assert!(turn > 0 || before.least_share() < 0.5, "{}", before.least_share());
            }
        }
    }
    let level = [DVec3::new(0.03, 0.0, 0.03), DVec3::ZERO, DVec3::X * 0.04, DVec3::Z * 0.04];
    let u = [DVec3::new(-0.05, 0.0, -0.05), DVec3::ZERO, DVec3::ZERO, DVec3::ZERO];
    let (plane, distance) = across(level, Kind::VertexTriangle);
    let before = plane.hold(lanes(u), [0.0; 4], 0.005, Kind::VertexTriangle);
    let held = plane.least_shortening(before, lanes(level), (lanes(u), [0.0; 4]), 0.005, Kind::VertexTriangle);
    assert!(held.shares[0] * 0.05 * 2.0_f32.sqrt() < 0.5 * distance, "{}", held.shares[0]);
}

/// What falls on a kinematic side from several thicknesses away is let through to less than a thickness, from a thickness or less no
/// farther than halfway, and never past the side, wherever this moves. Two free or two kinematic sides get the plane halfway.
#[test]
fn what_falls_on_a_kinematic_side_gets_there() {
    let thickness = 0.005_f64;
    let mut random = fastrand::Rng::with_seed(4);
    for case in 0..2000 {
        let kind = Kind::ALL[usize::from(case % 2 == 0)];
        let distance = thickness * (0.2 + 6.0 * random.f64());
        let x = match kind {
            Kind::VertexTriangle => [DVec3::Y * distance, DVec3::new(-0.03, 0.0, -0.02), DVec3::X * 0.04, DVec3::Z * 0.04],
            Kind::EdgeEdge => [
                DVec3::new(-0.02, distance, 0.01),
                DVec3::new(0.03, distance, 0.0),
                DVec3::new(0.0, 0.0, -0.02),
                DVec3::new(0.01, 0.0, 0.03),
            ],
        };
        let firsts = if kind == Kind::EdgeEdge { [1.0_f32, 1.0, 0.0, 0.0] } else { [1.0, 0.0, 0.0, 0.0] };
        let is_first_kinematic = case % 4 < 2;
        let kinematic = firsts.map(|first| if is_first_kinematic { first } else { 1.0 - first });
        let by = 0.2 * (random.f64() - 0.7) * distance;
        // Toward the kinematic side, and of that side.
        let ways = if is_first_kinematic { [by, 3.0 * distance] } else { [-3.0 * distance, -by] };
        let u = firsts.map(|first| DVec3::Y * ways[usize::from(first == 0.0)]);
        let (plane, _) = across(x, kind);
        let held = plane.hold(lanes(u), kinematic, thickness as f32, kind);
        assert!(held.passed_by == 0.0);
        let ends: Vec<f64> = (0..4).map(|k| x[k].y + u[k].y * f64::from(held.shares[k])).collect();
        let left = ends[0] - ends[3];
        let clearance = f64::from(held.plane.clearance);
        let most = (0.5 * distance).min(0.6 * thickness) + clearance + by.abs();
        assert!(left > clearance && left < most + 1e-6, "{kind:?}: {left} m of {distance}, at most {most}");
        for same in [0.0, 1.0] {
            let held = plane.hold(lanes([DVec3::ZERO; 4]), [same; 4], thickness as f32, kind);
            assert!(held.plane.heights == plane.heights);
        }
    }
}

#[test]
fn a_share_ends_at_the_plane() {
    let mut random = fastrand::Rng::with_seed(2);
    for _ in 0..1000 {
        let (distance, thickness) = (random.f32(), random.f32());
        let clearance = clearance(distance, thickness);
        assert!(clearance > 0.0 && clearance <= 0.5 * distance, "{clearance} of {distance}");
        let (height, toward) = (0.5 * distance + random.f32(), 4.0 * random.f32() - 2.0);
        let share = share_above(height, clearance, toward);
        assert!((0.0..=1.0).contains(&share) && height - share * toward >= clearance - 1e-6);
        assert!(share == 1.0 || (height - share * toward - clearance).abs() < 1e-5, "no shorter than it must be");
    }
}

/// What one plane, the same plane twice, and two planes at a right angle forbid is removed by the relaxation factor, and nothing
/// else.
#[test]
fn excess_is_what_planes_forbid() {
    let close = |a: Vec3A, b: Vec3A| assert!(a.distance(b) < 1e-6, "{a} {b}");
    let [x, y] = [Vec3A::X * 0.3, Vec3A::Y * 0.2];
    close(excess(x, 0.09), SLIDING * x);
    close(excess(2.0 * x, 0.18), SLIDING * x);
    close(excess(x + y, 0.09 + 0.04), SLIDING * (x + y));
    close(excess(Vec3A::ZERO, 0.0), Vec3A::ZERO);
}
