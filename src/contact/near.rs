//! Near pairs: the listed pairs that may come closer than their thickness in this substep, with the data of their
//! contact.

use glam::{Vec3A, Vec4};

use super::lanes::{corners_of, filled, scattered, whole_corners_of};
use super::pairs::{Kind, Listed, between, closest};
use super::surface::Surface;
use crate::kernels::pair::{NARROW, perpendicular};
use crate::simd::{Loop, MAX_LANES, Registers, Vector, Width};

/// A pair acts if it comes closer than its thickness plus this multiple of it. Other near pairs are held by truncation
/// only.
pub(super) const ACTING: f32 = 0.3;

/// A pair that is near in this substep.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    /// Places among the vertices of listed pairs.
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
}

/// What is found among consecutive pairs of a list.
#[derive(Debug, Default)]
pub(super) struct Portion {
    /// The near pairs.
    pub pairs: Vec<Near>,
    /// Which of them act, and how many pairs of this kind act in the portions before.
    pub acting: Vec<u32>,
    pub before: u32,
    /// How many of them press after the response.
    pub pressing: u32,
    /// For each vertex that truncation shortens, its place and the share of its displacement that is left.
    pub cut: Vec<(u32, f32)>,
}

/// A vertex of listed pairs.
#[derive(Debug, Clone, Copy, Default)]
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
    /// Their corners as places among the vertices of listed pairs, whose positions and displacements (m) these are; the
    /// w of a position is how far (m) the vertex is about to move relative to the mean displacement.
    pub corners: &'a [[u32; 4]],
    pub x: &'a [Vec4],
    pub u: &'a [Vec4],
    pub start: &'a Start<'a>,
    pub found: &'a mut Vec<Near>,
    /// Which of them act.
    pub acting: &'a mut Vec<u32>,
}

impl Loop for Find<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Find { kind, first, pairs, corners, x: at, u: by, start, found, acting } = self;
        acting.resize(pairs.len(), 0);
        let mut count = 0;
        let mut room = [[0; 4]; MAX_LANES];
        let (zero, one, most_push) = (L::splat(0.0), L::splat(1.0), L::splat(2.0 * start.most_push));
        for (group, (listed, corners)) in pairs.chunks(L::LANES).zip(corners.chunks(L::LANES)).enumerate() {
            let mut thickness = [0.0; MAX_LANES];
            for (lane, pair) in listed.iter().enumerate() {
                thickness[lane] = pair.thickness;
            }
            let places = filled::<L>(corners, &mut room);
            let thickness = L::from_slice(&thickness[..L::LANES]);
            let (x, travel) = whole_corners_of::<L>(at, places);
            let weights = closest(kind, x);
            let apart = between(weights, x);
            let (a, b) = match kind {
                Kind::VertexTriangle => (travel[0], travel[1].max(travel[2]).max(travel[3])),
                Kind::EdgeEdge => (travel[0].max(travel[1]), travel[2].max(travel[3])),
            };
            let distance = apart.dot(apart).sqrt();
            let left = distance - a - b - most_push;
            let all = (1_u32 << listed.len()) - 1;
            // A vector of no length has no direction.
            let mut lanes = L::bits(L::and(left.lt(thickness), L::splat(1e-12).lt(distance))) & all;
            if lanes == 0 {
                continue;
            }
            let mut normal = apart * (one / distance);
            let is_far = (thickness * L::splat(NARROW)).lt(distance);
            if L::bits(is_far) & lanes != lanes {
                let exact = perpendicular(apart, weights, x, kind == Kind::EdgeEdge);
                let length = exact.dot(exact).sqrt();
                // A vector that all but vanishes is noise.
                let is_kept = L::or(is_far, length.lt(distance * L::splat(0.5)));
                let of = |kept: L, exact: L| L::select(is_kept, kept, exact / length);
                normal = Vector::new(of(normal.x, exact.x), of(normal.y, exact.y), of(normal.z, exact.z));
            }
            let gap = distance - thickness + normal.dot(between(weights, corners_of::<L>(by, places)));
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
                // Without a branch, because pairs that act alternate with others.
                acting[count] = found.len() as u32;
                count += (acts >> lane & 1) as usize;
                found.push(Near {
                    corners: corners[lane],
                    normal: [normal.x, normal.y, normal.z],
                    distance: numbers.z,
                    thickness: pair.thickness,
                    free: numbers.x,
                    last: numbers.y,
                    listed: (first + group * L::LANES + lane) as u32,
                });
            }
        }
        acting.truncate(count);
    }
}
