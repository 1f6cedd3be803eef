//! Measures candidates and lists those that may come close enough.

use glam::Vec4;

use super::lanes::{corners_of, scattered, whole_corners_of};
use super::pairs::{Kind, Listed, between, closest, corners, square};
use super::surface::Surface;
use super::tree::Look;
use crate::simd::{Loop, MAX_LANES, Registers, Vector};

/// Lists the candidates that are close enough.
pub(super) struct Measure<'a> {
    pub surface: &'a Surface,
    pub look: Look,
    /// Midpoints of the vertices' paths (m); w is the distance that they may stray from them.
    pub middle: &'a [Vec4],
    pub u: &'a [Vec4],
    pub kind: Kind,
    pub near: &'a [[u32; 2]],
    pub listed: &'a mut Vec<(u32, Listed)>,
}

impl Loop for Measure<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Measure { surface, look, middle, u, kind, near, listed } = self;
        let thickness = look.margin;
        let half = L::splat(0.5 * look.substeps);
        for group in near.chunks(L::LANES) {
            let mut places = [corners(surface, kind, group[0]); MAX_LANES];
            places.iter_mut().zip(group).for_each(|(place, &pair)| *place = corners(surface, kind, pair));
            let ((y, [a, b, c, d]), u) = (whole_corners_of::<L>(middle, &places), corners_of::<L>(u, &places));
            let apart = between(closest(kind, y), y);
            let distance = apart.dot(apart).sqrt();
            let mut relative = square(u[0] - u[2]).max(square(u[0] - u[3]));
            relative = match kind {
                Kind::VertexTriangle => relative.max(square(u[0] - u[1])),
                Kind::EdgeEdge => relative.max(square(u[1] - u[2])).max(square(u[1] - u[3])),
            };
            let stray = match kind {
                Kind::VertexTriangle => a + b.max(c).max(d),
                Kind::EdgeEdge => a.max(b) + c.max(d),
            };
            // The part of the distance that is left for the pair's thickness.
            let left = distance - stray - relative.sqrt() * half;
            if L::all(L::splat(thickness).lt(left)) {
                continue;
            }
            let x = corners_of::<L>(&surface.rest, &places);
            let apart = between(closest(kind, x), x);
            let at_rest = apart.dot(apart).sqrt();
            let mut numbers = [Vec4::ZERO; MAX_LANES];
            scattered(Vector::new(left, at_rest, left), &mut numbers);
            for ((&[first, second], &corners), numbers) in group.iter().zip(&places).zip(&numbers) {
                let together = surface.piece[corners[0] as usize] == surface.piece[corners[3] as usize];
                let thickness = if together { thickness.min(0.5 * numbers.y) } else { thickness };
                if numbers.x < thickness {
                    listed.push((first, Listed { corners, other: second, thickness }));
                }
            }
        }
    }
}
