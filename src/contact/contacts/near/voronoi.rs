//! Whether the closest point of a triangle is the closest one of the surface around it.
//!
//! A vertex above a surface is close to several of its triangles. Of those that it is not above, the closest point is on a side or
//! at a corner, to which another triangle is closer. If such a pair acted, it would push the vertex aside: cloth that is closer than
//! the thickness would catch at each edge of a flat surface, even without friction. A point of a side or a corner is the closest
//! one only to what is in its Voronoi region (Ericson 2004, "Real-Time Collision Detection", 5.1.5, of a single triangle), where
//! none of the triangles around it is closer. The same holds from the other side: a corner of a flat surface next to the rim of
//! another one is not above it, and is not what the rim is closest to.

use glam::{Vec3A, Vec4};

use crate::contact::input::Vertex;
use crate::contact::surface::Surface;
use crate::contact::surface::lanes::{number, store};
use crate::kernels::integrate::xyz;
use crate::simd::{Bits, MAX_LANES, Registers};

/// A vertex counts as above a side or a corner, too, if it is beyond by an angle of at most this (rad): rounding must not leave it
/// beside all triangles.
pub(crate) const BESIDE: f32 = 0.01;

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
            along <= 0.0 || along <= BESIDE * apart.length() * way.length()
        };
        let triangles_at =
            |vertex: u32| self.surface.at.of(vertex).iter().map(|&triangle| self.surface.triangles[triangle as usize]);
        if !triangles_at(vertex).flatten().all(|other| is_above(-apart, at(other) - at(vertex))) {
            return false;
        }
        let Some(b) = b else {
            return triangles_at(a).flatten().all(|other| is_above(apart, at(other) - at(a)));
        };
        let side = at(b) - at(a);
        let across = |way: Vec3A| way - side * (way.dot(side) / side.length_squared().max(1e-30));
        let mut beside = triangles_at(a).filter(|triangle| triangle.contains(&b)).flatten().filter(|&other| other != b);
        beside.all(|other| is_above(apart, across(at(other) - at(a))))
    }
}
