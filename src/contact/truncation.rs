//! Guarantees that the two sides of a near pair stay on either side of the plane halfway between them, whatever moves
//! them.
//!
//! Displacements are taken relative to the mean displacement of the cloth, which brings nothing closer together, and
//! scaled to the largest share with which a vertex stays on its side of all its planes. (Lan et al. 2022 truncate along
//! the path; with one share per vertex, no order of pairs is needed.) Pairs that are not near need no plane: truncation
//! lets no vertex move farther than it was about to before the response, apart from an allowance ([`FARTHER`]). The
//! momentum that truncation removes is returned to the cloth as a whole if nothing else holds it.

use glam::{DVec3, Vec3A, Vec4};
use rayon::prelude::*;

use super::contacts::{Contacts, GRAIN};
use super::lanes::{corners_of, whole_corners_of};
use super::least;
use super::near::Near;
use super::pairs::{Kind, between};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{kept, share_above};
use crate::simd::{self, Loop, MAX_LANES, Registers, Vector, Width};

/// How much farther contact may move a vertex than it was about to move, as a multiple of its
/// [`Vertex::reach`](super::near::Vertex::reach).
pub(super) const FARTHER: f32 = 0.45;

impl Contacts {
    /// Shortens the displacements of vertices; `mean` is the mean displacement (m). Returns the momentum (kg m) that
    /// this removes.
    pub(super) fn truncate(&mut self, mean: Vec3A, mass: &[f32], is_shared: bool, width: Width) -> DVec3 {
        let Contacts { portions, used, vertices, x, u, by, .. } = self;
        let tasks = vertices.par_chunks_mut(GRAIN).zip(by.par_chunks_mut(GRAIN)).zip(u.par_chunks(GRAIN));
        tasks.with_min_len(least(is_shared)).for_each(|((vertices, by), u)| {
            for (vertex, (by, &u)) in vertices.iter_mut().zip(by.iter_mut().zip(u)) {
                let way = xyz(u) + vertex.push - mean;
                let (length, most) = (way.length(), vertex.travel + FARTHER * vertex.reach);
                vertex.share = if length > most && vertex.x.w > 0.0 { most / length } else { 1.0 };
                *by = way.extend(if vertex.x.w > 0.0 { 0.0 } else { 1.0 });
            }
        });
        let (x, by): (&[Vec4], &[Vec4]) = (x, by);
        for kind in Kind::ALL {
            let portions = &mut portions[kind as usize][..used[kind as usize]];
            portions.par_iter_mut().with_min_len(least(is_shared)).for_each(|portion| {
                portion.cut.clear();
                simd::run(width, Shares { kind, pairs: &portion.pairs, x, by, cut: &mut portion.cut });
            });
            for &(vertex, share) in portions.iter().flat_map(|portion| &portion.cut) {
                let vertex = &mut vertices[vertex as usize];
                vertex.share = vertex.share.min(share);
            }
        }
        let mut lost = DVec3::ZERO;
        for (vertex, u) in vertices.iter_mut().zip(u).filter(|(vertex, _)| vertex.share < 1.0) {
            let before = xyz(*u);
            let after = mean + (before - mean) * vertex.share;
            vertex.push *= vertex.share;
            lost += (before - after).as_dvec3() * f64::from(mass[vertex.index as usize]);
            *u = after.extend(0.0);
        }
        lost
    }
}

/// Computes the share of its displacement, relative to the mean, that each vertex of some pairs may take.
struct Shares<'a> {
    kind: Kind,
    pairs: &'a [Near],
    x: &'a [Vec4],
    by: &'a [Vec4],
    cut: &'a mut Vec<(u32, f32)>,
}

impl Loop for Shares<'_> {
    #[inline(always)]
    fn run<L: Registers>(self) {
        let Shares { kind, pairs, x, by, cut } = self;
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        for group in pairs.chunks(L::LANES) {
            let (mut places, mut numbers) = ([group[0].corners; MAX_LANES], [[0.0; MAX_LANES]; 7]);
            for (lane, pair) in group.iter().enumerate() {
                places[lane] = pair.corners;
                let [a, b, c] = pair.normal;
                let of = [a, b, c, pair.distance, pair.thickness, pair.free, pair.last];
                for k in 0..7 {
                    numbers[k][lane] = of[k];
                }
            }
            let normal = Vector::new(number(&numbers[0]), number(&numbers[1]), number(&numbers[2]));
            let (distance, thickness): (L, L) = (number(&numbers[3]), number(&numbers[4]));
            let weights = kind.wide_weights::<L>(number(&numbers[5]), number(&numbers[6]));
            let (at, (by, is_led)) = (corners_of::<L>(x, &places), whole_corners_of::<L>(by, &places));
            // A point halfway between the closest points.
            let none = Vector::<L>::zero();
            let first = match kind {
                Kind::VertexTriangle => at[0],
                Kind::EdgeEdge => between([weights[0], weights[1], zero, zero], [at[0], at[1], none, none]),
            };
            let middle = first - normal * (distance * L::splat(0.5));
            let kept = kept(distance, thickness);
            let mut heights = [zero; 4];
            let mut towards = [zero; 4];
            let (mut led_down, mut led_up) = (zero, zero);
            for k in 0..4 {
                let is_first = k < kind.first_side();
                let side = if is_first { one } else { L::splat(-1.0) };
                heights[k] = side * normal.dot(at[k] - middle);
                towards[k] = (zero - side) * normal.dot(by[k]);
                // Led vertices are never shortened. Where one moves across the plane, the plane moves with it.
                let out = (kept - (heights[k] - towards[k])).max(zero) * is_led[k];
                if is_first {
                    led_down = led_down.max(out);
                } else {
                    led_up = led_up.max(out);
                }
            }
            let led = led_up - led_down;
            for k in 0..4 {
                let along = if k < kind.first_side() { zero - led } else { led };
                let share = share_above(heights[k] + along, kept, towards[k]);
                let share = L::select(zero.lt(is_led[k]), one, share);
                let mut lanes = L::bits(share.lt(one)) & ((1_u32 << group.len()) - 1);
                if lanes != 0 {
                    let mut shares = [Vec4::ZERO; 4];
                    shares[..L::VECTORS].copy_from_slice(&share.to_vectors()[..L::VECTORS]);
                    while lanes != 0 {
                        let lane = lanes.trailing_zeros() as usize;
                        lanes &= lanes - 1;
                        cut.push((places[lane][k], shares[lane / 4][lane % 4]));
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn number<L: Registers>(of: &[f32; MAX_LANES]) -> L {
    L::from_slice(&of[..L::LANES])
}
