//! The narrow phase of detection measures the distance of each candidate and lists those that may come close enough.

use glam::Vec4;

use super::broad_phase::CLOSE_AT_REST;
use super::tree::DetectionScope;
use crate::contact::surface::lanes::{corners_of, store, whole_corners_of};
use crate::contact::surface::pairs::{Listed, corners, reach};
use crate::contact::surface::{LEAST_HELD, Surface};
use crate::kernels::pair::{Kind, between, closest, square, sum_of_sides};
use crate::simd::{Bits, Loop, MAX_LANES, Registers};

/// Lists the candidates that are close enough.
pub(crate) struct NarrowPhase<'a> {
    pub surface: &'a Surface,
    pub scope: DetectionScope,
    /// Midpoints of the vertices' paths (m); w is the distance that they may stray from them.
    pub middle: &'a [Vec4],
    pub u: &'a [Vec4],
    pub kind: Kind,
    pub near: &'a [[u32; 2]],
    pub listed: &'a mut Vec<(u32, Listed)>,
}

impl Loop for NarrowPhase<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let NarrowPhase { surface, scope, middle, u, kind, near, listed } = self;
        let thickness = scope.thickness;
        let half = L::splat(0.5 * scope.substeps);
        for group in near.chunks(L::LANES) {
            let of = |[first, second]: [u32; 2]| corners(surface, kind, [first, second & !CLOSE_AT_REST]);
            let mut places = [of(group[0]); MAX_LANES];
            places.iter_mut().zip(group).for_each(|(place, &pair)| *place = of(pair));
            let ((y, margins), u) = (whole_corners_of::<L>(middle, &places), corners_of::<L>(u, &places));
            let apart = between(closest(kind, y), y);
            let distance = apart.dot(apart).sqrt();
            let mut relative = square(u[0] - u[2]).max(square(u[0] - u[3]));
            relative = match kind {
                Kind::VertexTriangle => relative.max(square(u[0] - u[1])),
                Kind::EdgeEdge => relative.max(square(u[1] - u[2])).max(square(u[1] - u[3])),
            };
            // The part of the distance that is left.
            let left = distance - sum_of_sides(kind, margins) - relative.sqrt() * half;
            let close = L::bits(left.lt(L::splat(thickness))) & ((1 << group.len()) - 1);
            if close == 0 {
                continue;
            }
            let (mut lefts, mut at_rest) = ([0.0; MAX_LANES], [f32::INFINITY; MAX_LANES]);
            store(&mut lefts, left);
            if group.iter().any(|[_, second]| second & CLOSE_AT_REST != 0) {
                let x = corners_of::<L>(&surface.rest, &places);
                let apart = between(closest(kind, x), x);
                store(&mut at_rest, apart.dot(apart).sqrt());
            }
            for lane in Bits(close.into()) {
                let ([first, second], corners) = (group[lane], places[lane]);
                let together =
                    second & CLOSE_AT_REST != 0 && surface.piece[corners[0] as usize] == surface.piece[corners[3] as usize];
                let thickness =
                    if together { thickness.min((0.5 * at_rest[lane]).max(LEAST_HELD * thickness)) } else { thickness };
                if lefts[lane] < reach(kind, thickness, corners.map(|corner| surface.allowance[corner as usize])) {
                    listed.push((first, Listed { corners, other: second & !CLOSE_AT_REST, thickness }));
                }
            }
        }
    }
}
