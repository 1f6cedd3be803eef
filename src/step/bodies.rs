//! Analytic colliders as the kernels take them.

use std::mem::discriminant;

use glam::Vec3;

use crate::attributes::{Collider, Shape};
use crate::kernels::contact::{self, Body};
use crate::model::cloth::Cloth;

/// A plane whose normal turns by an angle with a smaller cosine in a step has its last normal at once.
const LEAST_TURN_COSINE: f64 = 0.5;

/// A collider as the kernels take it, in local coordinates, moving from `last` to `now` during the step. Round surfaces
/// are enlarged by 1.2 times the sagitta `l²/8R` of the longest edge, the depth to which it would cut into them between
/// its ends. Cloth that starts within that margin emerges from it slowly ([`contact::EMERGENCE`]).
pub(crate) fn moving(now: &Collider, last: &Collider, cloth: &Cloth) -> Body {
    let &Cloth { origin, longest_edge, mean_edge, .. } = cloth;
    let [shape, last] = [now, last].map(|collider| collider.relative_to(origin).shape);
    // If the kind of shape changed, there is no motion to interpolate.
    let last = if discriminant(&last) == discriminant(&shape) { last } else { shape.clone() };
    // A sharp edge (radius 0) is not enlarged.
    let sagitta = |radius: f32| if radius > 0.0 { 1.2 * longest_edge.min(radius).powi(2) / (8.0 * radius) } else { 0.0 };
    if let (Some(from), Some(to)) = (last.ends(), shape.ends()) {
        let [from_radii, to_radii] = [from, to].map(|ends| ends.map(|(_, radius)| radius + sagitta(radius)));
        let [from_taper, to_taper] = [from_radii, to_radii].map(|[a, b]| b - a);
        return Body {
            a: from[0].0.to_array(),
            radius: from_radii[0],
            b: from[1].0.to_array(),
            friction: now.friction,
            a_travel: (to[0].0 - from[0].0).to_array(),
            radius_travel: to_radii[0] - from_radii[0],
            b_travel: (to[1].0 - from[1].0).to_array(),
            kind: contact::ROUND,
            c: [from_taper, 0.0, 0.0, 0.0],
            c_travel: [to_taper - from_taper, 0.0, 0.0, 0.0],
            margin: from.into_iter().chain(to).map(|(_, radius)| sagitta(radius)).fold(0.0, f32::max),
            ..Body::default()
        };
    }
    match (shape, last) {
        (Shape::Plane { point, normal }, Shape::Plane { point: from, normal: normal0 }) => {
            let [first, to] = [normal0, normal].map(|normal| normal.as_dvec3().normalize());
            // What turns farther in a step has no known way.
            let first = if first.dot(to) < LEAST_TURN_COSINE { to } else { first };
            Body {
                a: from.to_array(),
                b: first.as_vec3().to_array(),
                friction: now.friction,
                a_travel: (point - from).to_array(),
                b_travel: (to - first).as_vec3().to_array(),
                kind: contact::PLANE,
                ..Body::default()
            }
        }
        (
            Shape::RoundedBox { center, half, rotation, radius },
            Shape::RoundedBox { center: from, half: half0, rotation: rotation0, radius: radius0 },
        ) => {
            let [first, to] = [rotation0, rotation].map(|rotation| rotation.as_dquat().normalize());
            // Each rotation has two quaternions; interpolate to the nearer one.
            let to = if first.dot(to) < 0.0 { -to } else { to };
            let (core0, core) = (half0 - radius0, half - radius);
            let [edge0, edge] = [radius0, radius].map(|radius| radius + sagitta(radius));
            Body {
                a: from.to_array(),
                radius: edge0,
                b: core0.to_array(),
                friction: now.friction,
                a_travel: (center - from).to_array(),
                radius_travel: edge - edge0,
                b_travel: (core - core0).to_array(),
                kind: contact::BOX,
                c: first.as_quat().to_array(),
                c_travel: (to - first).as_quat().to_array(),
                slick: slick(half, mean_edge),
                margin: sagitta(radius0).max(sagitta(radius)),
                ..Body::default()
            }
        }
        _ => unreachable!("a collider made of triangles is no analytic one"),
    }
}

/// [`Body::slick`] of a box: one and a half times the mean edge of the cloth, so that a cell of a grid, with its diagonal, does
/// not get stuck up to a friction of 1 (`rounded_box::grip`). On a box so small that little else would be left, a gripper's
/// finger, it is a quarter of the second longest side.
fn slick(half: Vec3, mean_edge: f32) -> f32 {
    let second = half.x.min(half.y).max(half.x.max(half.y).min(half.z));
    (1.5 * mean_edge).min(0.5 * second)
}
