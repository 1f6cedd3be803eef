//! Moves apart what touches exactly at the start, by a multiple of the distance that counts as touching.
//!
//! The vector between features that touch has no direction, or that of rounding errors. On which side of each other they
//! belong follows from [`Touches`]. Each pair is moved apart along the vector between its closest points there, which the
//! planes perpendicular to it separate.

use glam::{DVec3, Vec4};

use super::Features;
use super::overlaps::{Span, box_around, overlaps};
use super::touches::Touches;
use crate::model::csr::distinct;
use crate::model::mesh::along;

/// The distance (m) of what was moved apart, in units of the distance that counts as touching: so much that single
/// precision knows the direction, also between large triangles.
const GAP: f64 = 16.0;
/// The same distance is at most this share of the shorter edge.
const SHORT: f64 = 0.1;
/// Most rounds of moves.
const ROUNDS: usize = 50;
/// Least sum of squared weights of the vertices of a pair that may move. If the closest points are all but pinned, the others
/// would have to move without limit.
const MIN_SUM: f64 = 0.1;
/// Most pairs of boxes to compare, per triangle. Cloth that is crammed into one place has more, and stays as it is.
const ROOM: usize = 500;

/// Two features that touch: their vertices, the weights of these in the vector between the closest points, and its
/// direction.
struct Pair {
    corners: [u32; 4],
    weights: [f64; 4],
    normal: DVec3,
    /// How far apart (m) they are to be.
    gap: f64,
}

/// Moves apart what touches. Returns the vertices that move, with their new positions (m).
pub(crate) fn apart(features: Features<'_>) -> Vec<(u32, Vec4)> {
    let (x, normals) = features.in_general_position();
    let mut room = ROOM * features.triangles.len();
    let found = features.pierced(&x, &mut room);
    if room == 0 {
        return Vec::new();
    }
    let mut touches = Touches::new(features, x, normals);
    // What really intersects stays as it is; contact ignores it.
    let crossing = touches.left_out_of(found);
    let ends = crossing.iter().flat_map(|&[edge, _]| features.edges[edge as usize]);
    let corners = crossing.iter().flat_map(|&[_, triangle]| features.triangles[triangle as usize]);
    let of_crossings: Vec<u32> = distinct(ends.chain(corners).collect());
    let (mut x, gap) = (touches.x, GAP * features.touching());
    let mut pairs = pairs(features, &x, gap);
    pairs.retain(|pair| !pair.corners.iter().any(|vertex| of_crossings.binary_search(vertex).is_ok()));
    for _ in 0..ROUNDS {
        let mut is_apart = true;
        for &Pair { corners, weights, normal, gap } in &pairs {
            let share = corners.map(|vertex| f64::from(features.x[vertex as usize].w > 0.0));
            let distance: f64 =
                corners.iter().zip(weights).map(|(&vertex, weight)| weight * x[vertex as usize].dot(normal)).sum();
            let sum: f64 = weights.iter().zip(share).map(|(weight, share)| share * weight * weight).sum();
            if distance < gap && sum > 0.0 {
                is_apart &= distance > 0.9 * gap;
                let along = normal * ((gap - distance) / sum.max(MIN_SUM));
                corners
                    .iter()
                    .zip(weights)
                    .zip(share)
                    .for_each(|((&v, weight), share)| x[v as usize] += along * (weight * share));
            }
        }
        if is_apart {
            break;
        }
    }
    let moved: Vec<u32> = distinct(pairs.iter().flat_map(|pair| pair.corners).collect());
    let place = |vertex: u32| (vertex, x[vertex as usize].as_vec3().extend(features.x[vertex as usize].w));
    moved.into_iter().filter(|&vertex| features.x[vertex as usize].w > 0.0).map(place).collect()
}

/// The pairs of features that are closer than `reach` (m) at `x` (m).
fn pairs(features: Features<'_>, x: &[DVec3], reach: f64) -> Vec<Pair> {
    let Features { edges, triangles, .. } = features;
    let at = |vertex: u32| x[vertex as usize];
    let vertices: Vec<u32> = distinct(triangles.iter().flatten().copied().collect());
    let of_vertices: Vec<Span> = vertices.iter().map(|&vertex| box_around(&[at(vertex)], reach)).collect();
    let of_edges: Vec<Span> = edges.iter().map(|ends| box_around(&ends.map(at), 0.5 * reach)).collect();
    let of_triangles: Vec<Span> = triangles.iter().map(|corners| box_around(&corners.map(at), 0.0)).collect();
    let mut room = ROOM * triangles.len();
    // A share of the shortest edge, so that far from the origin, where rounding is coarse, fine cloth is not torn apart.
    let gap_of = |shortest: f64| reach.min((SHORT * shortest).max(GAP * features.share_of_thickness()));
    let pair = |corners: [u32; 4], weights: [f64; 4], shortest: f64| {
        let apart: DVec3 = corners.iter().zip(weights).map(|(&vertex, weight)| at(vertex) * weight).sum();
        let gap = gap_of(shortest);
        (apart.length() < gap).then(|| Pair { corners, weights, normal: apart.normalize_or_zero(), gap })
    };
    let of_vertex = |vertex: usize, triangle: usize| {
        let (vertex, [a, b, c]) = (vertices[vertex], triangles[triangle]);
        if !features.may_collide(vertex, a) || [a, b, c].contains(&vertex) {
            return None;
        }
        let [p, q, r] = [a, b, c].map(at);
        let [of_a, of_b, of_c] = nearest(at(vertex), [p, q, r]);
        let shortest = p.distance(q).min(q.distance(r)).min(r.distance(p));
        pair([vertex, a, b, c], [1.0, -of_a, -of_b, -of_c], shortest)
    };
    let of_two_edges = |one: usize, other: usize| {
        let ([a, b], [c, d]) = (edges[one], edges[other]);
        if one >= other || !features.may_collide(a, c) || a == c || a == d || b == c || b == d {
            return None;
        }
        let [s, t] = closest([at(a), at(b)], [at(c), at(d)]);
        let shortest = at(a).distance(at(b)).min(at(c).distance(at(d)));
        pair([a, b, c, d], [1.0 - s, s, t - 1.0, -t], shortest)
    };
    let mut search = |one: &[Span], other: &[Span], pair: &(dyn Fn(usize, usize) -> Option<Pair> + Sync)| {
        let found = overlaps(one, other, &mut room, features.is_shared, &|a, b| pair(a, b).is_some());
        found.into_iter().filter_map(|[a, b]| pair(a as usize, b as usize)).collect::<Vec<Pair>>()
    };
    let mut pairs = search(&of_vertices, &of_triangles, &of_vertex);
    pairs.extend(search(&of_edges, &of_edges, &of_two_edges));
    pairs.sort_unstable_by_key(|pair| pair.corners);
    if room > 0 { pairs } else { Vec::new() }
}

/// The weights of the point of a triangle that is nearest to `p`.
fn nearest(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let share = |from: DVec3, to: DVec3| (to - from).cross(p - from).dot(normal) / normal.length_squared();
    let inside = [share(b, c), share(c, a), share(a, b)];
    if inside.iter().all(|&share| share > 0.0) {
        return inside;
    }
    let [s, t, r] = [[a, b], [b, c], [c, a]].map(|side| along(p, side));
    let on_sides = [[1.0 - s, s, 0.0], [0.0, 1.0 - t, t], [r, 0.0, 1.0 - r]];
    let far = |[of_a, of_b, of_c]: &[f64; 3]| (a * *of_a + b * *of_b + c * *of_c).distance_squared(p);
    on_sides.into_iter().min_by(|one, other| far(one).total_cmp(&far(other))).unwrap_or([1.0, 0.0, 0.0])
}

/// The parameters of the closest points of two segments.
fn closest([a, b]: [DVec3; 2], [c, d]: [DVec3; 2]) -> [f64; 2] {
    let (e, f) = (b - a, d - c);
    let normal = e.cross(f);
    let [s, t] = [f, e].map(|other| (c - a).cross(other).dot(normal) / normal.length_squared());
    if [s, t].iter().all(|of| (0.0..=1.0).contains(of)) {
        return [s, t];
    }
    // One of them is an end.
    let ends = [[0.0, along(a, [c, d])], [1.0, along(b, [c, d])], [along(c, [a, b]), 0.0], [along(d, [a, b]), 1.0]];
    let far = |[s, t]: &[f64; 2]| (a + e * *s).distance_squared(c + f * *t);
    ends.into_iter().min_by(|one, other| far(one).total_cmp(&far(other))).unwrap_or([0.0, 0.0])
}
