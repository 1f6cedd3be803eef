//! Near pairs: the listed pairs that may come closer than their thickness in this substep, with the data of their
//! contact.

use glam::{Vec3A, Vec4};

use super::coincident::{TOUCHING, coincident};
use super::detection::{Kind, Listed, between, closest, square};
use super::lanes::{corners_of, scattered};
use super::surface::Surface;
use crate::simd::{Loop, MAX_LANES, Registers, Vector, Width};

/// A pair acts if it comes closer than its thickness plus this multiple of it. Other near pairs are held by truncation
/// only.
pub(super) const ACTING: f32 = 0.3;

/// A pair that is near in this substep.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    /// Vertices of the cloth; after [`Contacts`](super::contacts::Contacts) has gathered them, indices of near
    /// vertices.
    pub corners: [u32; 4],
    /// Unit vector from the second side to the first.
    pub normal: [f32; 3],
    /// The distance at the start of the substep (m), and the distance at which the pair is held (m).
    pub distance: f32,
    pub thickness: f32,
    /// The two weights that determine all four: see [`Kind::weights`].
    pub free: f32,
    pub last: f32,
    /// Index in the list.
    pub listed: u32,
    pub acts: bool,
}

impl Kind {
    /// The weights of a pair's four corners; they sum to 1 on the first side and -1 on the second.
    pub(super) fn weights(self, free: f32, last: f32) -> [f32; 4] {
        match self {
            Kind::VertexTriangle => [1.0, -1.0 - free - last, free, last],
            Kind::EdgeEdge => [1.0 - free, free, -1.0 - last, last],
        }
    }

    /// The same for as many pairs as there are lanes.
    #[inline(always)]
    pub(super) fn wide_weights<L: Registers>(self, free: L, last: L) -> [L; 4] {
        let one = L::splat(1.0);
        match self {
            Kind::VertexTriangle => [one, L::splat(-1.0) - free - last, free, last],
            Kind::EdgeEdge => [one - free, free, L::splat(-1.0) - last, last],
        }
    }

    /// The number of corners on the first side.
    pub(super) fn first_side(self) -> usize {
        match self {
            Kind::VertexTriangle => 1,
            Kind::EdgeEdge => 2,
        }
    }
}

/// A vertex of near pairs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    pub index: u32,
    /// Position (m); w is the inverse mass (1/kg).
    pub x: Vec4,
    /// Correction of the position (m) that adds no velocity.
    pub push: Vec3A,
    /// Sum of its weights in the pairs that act.
    pub weight: f32,
    /// How far (m) it was about to move relative to the mean displacement, and half of the smallest thickness around
    /// it.
    pub travel: f32,
    pub reach: f32,
    /// The share of its displacement that truncation leaves.
    pub share: f32,
}

/// The input of contact in a substep.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    /// Corrections of positions (m) by colliders; empty if there are none.
    pub push: &'a [Vec4],
    /// The length of the longest of them (m).
    pub most_push: f32,
    pub mean: Vec3A,
    /// Whether there are no multipliers from an earlier substep.
    pub begins: bool,
    pub surface: &'a Surface,
    /// Friction coefficients by owner of the pair: see [`Bodies::friction`](super::bodies::Bodies).
    pub friction: &'a [f32],
    pub is_shared: bool,
    pub width: Width,
}

/// Finds the near pairs among listed pairs.
pub(super) struct Find<'a> {
    pub kind: Kind,
    /// Index in the list of the first pair.
    pub first: usize,
    pub pairs: &'a [Listed],
    pub start: &'a Start<'a>,
    pub found: &'a mut Vec<Near>,
}

impl Loop for Find<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Find { kind, first, pairs, start, found } = self;
        let mean = Vector::<L>::splat(start.mean.to_array());
        let (zero, one, most_push) = (L::splat(0.0), L::splat(1.0), L::splat(2.0 * start.most_push));
        for (group, listed) in pairs.chunks(L::LANES).enumerate() {
            let (mut places, mut thickness) = ([listed[0].corners; MAX_LANES], [0.0; MAX_LANES]);
            for (lane, pair) in listed.iter().enumerate() {
                (places[lane], thickness[lane]) = (pair.corners, pair.thickness);
            }
            let thickness = L::from_slice(&thickness[..L::LANES]);
            let least = if start.begins { thickness * L::splat(TOUCHING) } else { L::splat(1e-12) };
            let (x, u) = (corners_of::<L>(start.x, &places), corners_of::<L>(start.u, &places));
            let travel = [square(u[0] - mean), square(u[1] - mean), square(u[2] - mean), square(u[3] - mean)];
            let weights = closest(kind, x);
            let apart = between(weights, x);
            let (a, b) = match kind {
                Kind::VertexTriangle => (travel[0], travel[1].max(travel[2]).max(travel[3])),
                Kind::EdgeEdge => (travel[0].max(travel[1]), travel[2].max(travel[3])),
            };
            let distance = apart.dot(apart).sqrt();
            let left = distance - a.sqrt() - b.sqrt() - most_push;
            let all = (1_u32 << listed.len()) - 1;
            let (near, is_apart) = (left.lt(thickness), least.lt(distance));
            let mut touching = L::bits(near) & all & !L::bits(is_apart);
            // The vector between edges that touch has no direction. They are held apart once their ends are.
            while start.begins && kind == Kind::VertexTriangle && touching != 0 {
                let lane = touching.trailing_zeros() as usize;
                touching &= touching - 1;
                let Listed { corners, thickness, .. } = listed[lane];
                let Some((normal, [free, last])) = coincident(start.surface, start.x, corners) else { continue };
                let listed = (first + group * L::LANES + lane) as u32;
                found.push(Near { corners, normal, distance: 0.0, thickness, free, last, listed, acts: true });
            }
            let mut lanes = L::bits(L::and(near, is_apart)) & all;
            if lanes == 0 {
                continue;
            }
            let normal = apart * (one / distance);
            let gap = distance - thickness + normal.dot(between(weights, u));
            let mut acts = gap.lt(thickness * L::splat(ACTING));
            let free = match kind {
                Kind::VertexTriangle => weights[2],
                // If the closest point is an end of an edge, a vertex-triangle pair acts there instead.
                Kind::EdgeEdge => {
                    let (s, t) = (weights[1], weights[3]);
                    let inner = L::and(L::and(zero.lt(s), s.lt(one)), L::and(t.lt(zero), L::splat(-1.0).lt(t)));
                    acts = L::and(acts, inner);
                    s
                }
            };
            let acts = L::bits(acts);
            let (mut normals, mut numbers) = ([Vec4::ZERO; MAX_LANES], [Vec4::ZERO; MAX_LANES]);
            scattered(normal, &mut normals);
            scattered(Vector::new(free, weights[3], distance), &mut numbers);
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let (pair, normal, numbers) = (&listed[lane], normals[lane], numbers[lane]);
                found.push(Near {
                    corners: pair.corners,
                    normal: [normal.x, normal.y, normal.z],
                    distance: numbers.z,
                    thickness: pair.thickness,
                    free: numbers.x,
                    last: numbers.y,
                    listed: (first + group * L::LANES + lane) as u32,
                    acts: acts >> lane & 1 != 0,
                });
            }
        }
    }
}
