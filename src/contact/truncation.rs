//! The guarantee: whatever moves them, the two sides of a near pair stay on either side of the plane half way between them.
//!
//! Displacements are taken relative to how the cloth moves as a whole, which brings nothing nearer to anything, and shortened to the
//! largest share with which a vertex stays on its side of all its planes (Lan et al. 2022 do so along the path; here
//! a share for each vertex needs no order). Pairs that are not near are held by nothing, and need not be: no vertex goes farther than it was on
//! its way to, but for [`FARTHER`]. What momentum that takes away is given back to the cloth as a whole, where nothing else holds it.

use glam::{DVec3, Vec3A};

use super::for_chunks;
use super::near::{Contacts, Near, Vertex};
use super::response::GRAIN;
use crate::kernels::pair::{kept, share_above};

/// How much farther (m per m of its [`Vertex::reach`]) than it was on its way contact may send a vertex.
const FARTHER: f32 = 0.45;

impl Contacts {
    /// Shortens the displacements of vertices; `mean` is how the cloth moves as a whole. Returns the momentum (kg m) that is lost.
    pub(super) fn truncate(&mut self, mean: Vec3A, mass: &[f32], is_shared: bool) -> DVec3 {
        self.follow_the_led(mean);
        let Contacts { pairs, vertices, corners, corner_starts, .. } = self;
        for_chunks(is_shared, vertices, GRAIN, |first, vertices| {
            for (vertex, range) in
                vertices.iter_mut().zip(corner_starts[first..].windows(2)).filter(|(vertex, _)| vertex.x.w > 0.0)
            {
                let corners = &corners[range[0] as usize..range[1] as usize];
                vertex.share = share(vertex, vertex.u + vertex.push - mean, corners, pairs);
            }
        });
        let mut lost = DVec3::ZERO;
        for vertex in vertices.iter_mut().filter(|vertex| vertex.share < 1.0) {
            let before = vertex.u;
            vertex.u = mean + (vertex.u - mean) * vertex.share;
            vertex.push *= vertex.share;
            lost += (before - vertex.u).as_dvec3() * f64::from(mass[vertex.index as usize]);
        }
        lost
    }

    /// Moves the planes of pairs with vertices that are led, which nothing shortens, out of their way.
    fn follow_the_led(&mut self, mean: Vec3A) {
        let Contacts { pairs, vertices, .. } = self;
        for pair in pairs {
            for (k, &corner) in pair.corners.iter().enumerate() {
                let vertex = &vertices[corner as usize];
                let side = side(pair, k);
                if vertex.x.w == 0.0 && vertex.u != mean {
                    let left = height(pair, vertex, side) + side * pair.normal.dot(vertex.u - mean);
                    let out = (kept(pair.distance, pair.thickness) - left).max(0.0);
                    pair.led = if side > 0.0 { pair.led.min(-out) } else { pair.led.max(out) };
                }
            }
        }
    }
}

/// 1 for the corners of a pair's first side, -1 for those of its second.
fn side(pair: &Near, corner: usize) -> f32 {
    if corner < pair.first_side as usize { 1.0 } else { -1.0 }
}

/// How far (m) a vertex is on its side of a pair's plane at the start.
fn height(pair: &Near, vertex: &Vertex, side: f32) -> f32 {
    side * pair.normal.dot(Vec3A::from_vec4(vertex.x) - pair.middle)
}

/// How much of its displacement, the cloth's as a whole left out, a vertex may take.
fn share(vertex: &Vertex, by: Vec3A, corners: &[u32], pairs: &[Near]) -> f32 {
    let most = vertex.travel + FARTHER * vertex.reach;
    let length = by.length();
    let mut share: f32 = if length > most { most / length } else { 1.0 };
    for &corner in corners {
        let pair = &pairs[corner as usize / 4];
        let side = side(pair, corner as usize % 4);
        let above = height(pair, vertex, side) - side * pair.led;
        share = share.min(share_above(above, kept(pair.distance, pair.thickness), -side * pair.normal.dot(by)));
    }
    share
}
