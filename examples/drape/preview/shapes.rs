//! Colliders in the preview picture.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Collider, Shape};

/// Most steps of a ray toward a surface.
const STEPS: usize = 96;

/// The distance along a ray, in units of `direction`, at which it enters the shape, if it does.
pub(super) fn trace(shape: &Shape, origin: Vec3, direction: Vec3) -> Option<f32> {
    let ball = |center: Vec3, radius: f32| {
        let (a, b) = (direction.length_squared(), direction.dot(origin - center));
        let inside = b * b - a * ((origin - center).length_squared() - radius * radius);
        (inside >= 0.0).then(|| (-b - inside.sqrt()) / a)
    };
    let hit = match *shape {
        Shape::Sphere { center, radius } => ball(center, radius),
        Shape::Plane { point, normal } => {
            let speed = direction.dot(normal);
            (speed < 0.0).then(|| (point - origin).dot(normal) / speed)
        }
        _ => {
            // Sphere tracing (Hart 1996), starting at the bounding sphere: each step advances by the distance from the
            // surface.
            let (center, radius) = around(shape)?;
            let collider = Collider { shape: shape.clone(), ..Collider::default() };
            let (near, far) = (ball(center, radius)?.max(0.0), 2.0 * radius);
            let unit = direction.length();
            let mut s = near;
            let mut last = f32::INFINITY;
            let is_hit = (0..STEPS).any(|_| {
                let distance = collider.distance(origin + s * direction);
                // The shape is convex: a ray that goes away from it never comes back.
                let is_over = distance > last;
                last = distance;
                s += if is_over { f32::INFINITY } else { distance / unit };
                distance < 1e-4 * radius || (s - near) * unit > far
            });
            (is_hit && (s - near) * unit <= far).then_some(s)
        }
    };
    hit.filter(|&t| t > 0.0)
}

/// A bounding sphere of a shape of finite size.
fn around(shape: &Shape) -> Option<(Vec3, f32)> {
    match *shape {
        Shape::Sphere { center, radius } => Some((center, radius)),
        Shape::Capsule { a, b, radius } => Some((0.5 * (a + b), 0.5 * a.distance(b) + radius)),
        Shape::TaperedCapsule { a, radius_a, b, radius_b } => Some((0.5 * (a + b), 0.5 * a.distance(b) + radius_a.max(radius_b))),
        Shape::RoundedBox { center, half, .. } => Some((center, half.length())),
        _ => None,
    }
}

/// The normal of a shape at a point of its surface.
pub(super) fn collider_normal(shape: &Shape, at: Vec3) -> Vec3 {
    match *shape {
        Shape::Sphere { center, .. } => at - center,
        Shape::Plane { normal, .. } => normal,
        // Central differences of the distance along each axis.
        _ => {
            let collider = Collider { shape: shape.clone(), ..Collider::default() };
            let step = around(shape).map_or(1e-3, |(_, radius)| 1e-3 * radius);
            let along = |axis: Vec3| collider.distance(at + step * axis) - collider.distance(at - step * axis);
            Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z))
        }
    }
    .normalize_or_zero()
}

/// The collider as it is drawn, slightly smaller than it is. Otherwise cloth that lies on it would flicker through,
/// because its triangles are chords of a round surface (sagitta `edge² / 8r` on each side) and coincide with a plane.
pub(super) fn shrunk(collider: &Collider, edge: f32, scene: f32) -> Collider {
    let gap = 0.002 * scene;
    let smaller = |radius: f32| (radius - gap - edge * edge / (4.0 * radius)).max(0.9 * radius);
    let shape = match collider.shape {
        Shape::Sphere { center, radius } => Shape::Sphere { center, radius: smaller(radius) },
        Shape::Plane { point, normal } => Shape::Plane { point: point - gap * normal.normalize_or_zero(), normal },
        Shape::Capsule { a, b, radius } => Shape::Capsule { a, b, radius: smaller(radius) },
        Shape::TaperedCapsule { a, radius_a, b, radius_b } => {
            Shape::TaperedCapsule { a, radius_a: smaller(radius_a), b, radius_b: smaller(radius_b) }
        }
        Shape::RoundedBox { center, half, rotation, radius } => {
            // A sharp edge can be cut by a chord as long as a cloth edge, so round edges are drawn a little rounder.
            let half = (half - gap).max(0.9 * half);
            let radius = (radius + 0.1 * edge).min(half.min_element());
            Shape::RoundedBox { center, half, rotation, radius }
        }
        ref other => other.clone(),
    };
    Collider { shape, ..*collider }
}

/// Corners of a box around a shape of finite size, or points of the shape itself.
pub(super) fn corners(shape: &Shape) -> Vec<Vec3> {
    let signs = |corner: i32| {
        let sign = |bit: i32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
        Vec3::new(sign(0), sign(1), sign(2))
    };
    // The corners of a sphere's bounding box are far from the sphere. These points also touch it along the diagonals.
    let around = |center: Vec3, radius: f32| (0..8).map(move |corner| center + 0.8 * radius * signs(corner));
    match *shape {
        Shape::Sphere { center, radius } => around(center, radius).collect(),
        Shape::Capsule { a, b, radius } => around(a, radius).chain(around(b, radius)).collect(),
        Shape::TaperedCapsule { a, radius_a, b, radius_b } => around(a, radius_a).chain(around(b, radius_b)).collect(),
        Shape::RoundedBox { center, half, rotation, .. } => {
            (0..8).map(|corner| center + rotation.normalize() * (half * signs(corner))).collect()
        }
        Shape::Mesh { ref mesh } => mesh.positions.clone(),
        _ => Vec::new(),
    }
}
