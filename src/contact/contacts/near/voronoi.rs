//! Whether the closest points of a pair are the closest ones of the surfaces around them.
//!
//! A vertex above a surface is close to several of its triangles. Of those that it is not above, the closest point is on a side or
//! at a corner, to which another triangle is closer. If such a pair acted, it would push the vertex aside: cloth that is closer than
//! the thickness would catch at each edge of a flat surface, even without friction. A point of a side or a corner is the closest
//! one only to what is in its Voronoi region (Ericson 2004, "Real-Time Collision Detection", 5.1.5, of a single triangle), where
//! none of the triangles around it is closer. The same holds from the other side: a corner of a flat surface next to the rim of
//! another one is not above it, and is not what the rim is closest to.
//!
//! Two edges that all but run alongside each other have a common perpendicular in any direction, also along the surfaces. Pairs of
//! edges for which it leads beyond an edge, above one of the triangles there, drag along what slides, and throw it aside where it
//! lands.

use glam::{Vec3A, Vec4};

use crate::contact::input::Vertex;
use crate::contact::surface::Surface;
use crate::contact::surface::lanes::{corners_of, number, store};
use crate::kernels::integrate::xyz;
use crate::simd::{Bits, MAX_LANES, Registers, Vector};

/// A vertex counts as above a side or a corner, too, if it is beyond by an angle of at most this (rad): rounding must not leave it
/// beside all triangles.
pub(crate) const ABOVE_ANGLE: f32 = 0.01;
/// Edges run alongside each other if the squared sine of the angle between them is less than this. Only such pairs are tested: the
/// common perpendicular of others is tilted by little, and cloth that is squeezed on a body would lose hold of it.
pub(crate) const ALONGSIDE: f32 = 0.01;

/// A closest point is on a side or at a corner if a weight is less than this: it may not be 0 because of rounding.
pub(crate) const ON_SIDE: f32 = 1e-5;

/// The surface around pairs: its vertices' positions (m), and the vertices of listed pairs.
#[derive(Clone, Copy)]
pub(crate) struct Around<'a> {
    pub surface: &'a Surface,
    pub x: &'a [Vec4],
    pub vertices: &'a [Vertex],
}

impl Around<'_> {
    /// For each pair of a vertex and a triangle in some lanes, given as bits, with its corners and their weights: 1 if another
    /// triangle is closer, otherwise 0.
    #[inline(always)]
    pub(crate) fn beside<L: Registers>(self, lanes: u32, corners: &[[u32; 4]], weights: [L; 4]) -> L {
        let (mut of, mut beside) = ([[0.0; MAX_LANES]; 4], [0.0; MAX_LANES]);
        for k in 1..4 {
            store(&mut of[k], weights[k]);
        }
        for lane in Bits(lanes.into()) {
            let [vertex, corners @ ..] = corners[lane].map(|place| self.vertices[place as usize].index);
            let [_, weights @ ..] = [0, 1, 2, 3].map(|k: usize| of[k][lane]);
            beside[lane] = if self.is_closest(vertex, corners, weights) { 0.0 } else { 1.0 };
        }
        number(&beside, 0)
    }

    /// The vertices opposite the edges of a pair on the triangles there: two of the first edge, and two of the second. On a border it
    /// is one vertex twice; of more than two they are the first.
    pub(crate) fn opposite(self, corners: [u32; 4]) -> [u32; 4] {
        let [a, b, c, d] = corners.map(|place| self.vertices[place as usize].index);
        let [[e, f], [g, h]] = [[a, b], [c, d]].map(|ends| self.opposite_edge(ends));
        [e, f, g, h]
    }

    fn opposite_edge(self, [a, b]: [u32; 2]) -> [u32; 2] {
        let beside = self.triangles_at(a).filter(|triangle| triangle.contains(&b));
        let mut opposite = beside.flatten().filter(|vertex| ![a, b].contains(vertex));
        let one = opposite.next().unwrap_or(a);
        [one, opposite.next().unwrap_or(one)]
    }

    fn triangles_at(self, vertex: u32) -> impl Iterator<Item = [u32; 3]> {
        self.surface.at.of(vertex).iter().map(move |&triangle| self.surface.triangles[triangle as usize])
    }

    /// For pairs of edges that are apart in a direction: 1 if other points of the surfaces, which go on at the
    /// [`opposite`](Around::opposite) vertices, are closer to each other, otherwise 0.
    #[inline(always)]
    pub(crate) fn edges_beside<L: Registers>(self, opposite: &[[u32; 4]], [a, b, c, d]: [Vector<L>; 4], apart: Vector<L>) -> L {
        let [e, f, g, h] = corners_of::<L>(self.x, opposite);
        let (first, second, back) = (b - a, d - c, Vector::zero() - apart);
        let of_first = beyond(back, first, e - a).max(beyond(back, first, f - a));
        of_first.max(beyond(apart, second, g - c).max(beyond(apart, second, h - c)))
    }

    /// Whether the point of a triangle with these weights, which sum to -1, is the point of the surface around it that is closest
    /// to a vertex, and the vertex the point of its surface that is closest to it.
    fn is_closest(&self, vertex: u32, corners: [u32; 3], weights: [f32; 3]) -> bool {
        let at = |vertex: u32| xyz(self.x[vertex as usize]);
        let apart = corners.into_iter().zip(weights).fold(at(vertex), |apart, (corner, weight)| apart + at(corner) * weight);
        let mut used = corners.into_iter().zip(weights).filter(|(_, weight)| *weight < -ON_SIDE).map(|(corner, _)| corner);
        let (Some(a), b) = (used.next(), used.next()) else { return true };
        if used.next().is_some() {
            return true;
        }
        // Most ways lead off, which needs no lengths.
        let is_above = |apart: Vec3A, way: Vec3A| {
            let along = apart.dot(way);
            along <= 0.0 || along <= ABOVE_ANGLE * apart.length() * way.length()
        };
        let ring = |vertex: u32| self.surface.ring.of(vertex).iter().map(move |&other| at(other) - at(vertex));
        if !ring(vertex).all(|way| is_above(-apart, way)) {
            return false;
        }
        let Some(b) = b else {
            return ring(a).all(|way| is_above(apart, way));
        };
        let side = at(b) - at(a);
        let across = |way: Vec3A| way - side * (way.dot(side) / side.length_squared().max(1e-30));
        let mut beside = self.triangles_at(a).filter(|triangle| triangle.contains(&b)).flatten().filter(|&other| other != b);
        beside.all(|other| is_above(apart, across(at(other) - at(a))))
    }
}

/// Whether the edges of pairs run alongside each other.
#[inline(always)]
pub(crate) fn run_alongside<L: Registers>([a, b, c, d]: [Vector<L>; 4]) -> L::Mask {
    let (first, second) = (b - a, d - c);
    let across = first.cross(second);
    across.dot(across).lt(first.dot(first) * second.dot(second) * L::splat(ALONGSIDE))
}

/// 1 if a direction from a point of an edge leads beyond it on the triangle there, to whose opposite corner it is `way` (m) from an
/// end of the edge, otherwise 0.
#[inline(always)]
fn beyond<L: Registers>(direction: Vector<L>, edge: Vector<L>, way: Vector<L>) -> L {
    let across = way - edge * (way.dot(edge) / edge.dot(edge).max(L::splat(1e-30)));
    L::select((across.length() * L::splat(ABOVE_ANGLE)).lt(direction.dot(across)), L::splat(1.0), L::splat(0.0))
}
