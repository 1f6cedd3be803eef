//! The imperfection without which flat cloth could not buckle.

use glam::{Vec3, Vec4};

use crate::deformer::Deformer;
use crate::model::flat_parts::{FlatPart, flat_parts};

/// How far vertices are moved out of the plane: as a share of the part's size, and at least this multiple of the rounding
/// of its largest coordinate.
const IMPERFECTION: f64 = 1e-6;
const ROUNDINGS: f64 = 4.0;
/// A force that has a larger share than this across the plane bends the cloth itself.
const ACROSS: f64 = 1e-6;

/// A state that the caller has placed, of which a part is flat, until a step begins from it.
#[derive(Debug)]
pub(super) struct FlatStart {
    x: Vec<Vec4>,
    p: Vec<Vec4>,
    parts: Vec<FlatPart>,
}

impl FlatStart {
    /// None if no part of the cloth at `x` is flat. `p` are the displacements with which it was placed.
    pub(super) fn new(x: &[Vec4], p: &[Vec4], triangles: &[[u32; 3]]) -> Option<FlatStart> {
        let parts = flat_parts(x, triangles);
        (!parts.is_empty()).then(|| FlatStart { x: x.to_vec(), p: p.to_vec(), parts })
    }
}

impl Deformer {
    /// Before the first step from a placed state, moves the free vertices of exactly flat parts out of their plane, each
    /// by up to a millionth of the part's size. Compression within the plane has no reason to bend such a part to one side
    /// rather than the other, so it would be crushed there, however far; real cloth is never that flat. Where gravity acts
    /// across the plane it bends the cloth by itself, so nothing is moved.
    pub(super) fn make_imperfect(&mut self, gravity: Vec3) {
        let gravity = gravity.as_dvec3();
        let is_along = |part: &&FlatPart| gravity.dot(part.normal).abs() <= ACROSS * gravity.length();
        let Some(FlatStart { x, p, parts }) = &self.flat_start else { return };
        let mut parts = parts.iter().filter(is_along).peekable();
        if parts.peek().is_none() {
            return;
        }
        let mut x = self.with_weights(x);
        for FlatPart { normal, vertices, extent, farthest } in parts {
            let most = (IMPERFECTION * extent).max(ROUNDINGS * f64::from(f32::EPSILON) * farthest);
            for &vertex in vertices {
                let (x, name) = (&mut x[vertex as usize], self.cloth.order[vertex as usize]);
                if x.w > 0.0 {
                    *x += (normal * (most * noise(name))).as_vec3().extend(0.0);
                }
            }
        }
        self.engine.put(&x, p);
        self.is_current = false;
    }

    /// Undoes [`Deformer::make_imperfect`] after a step that failed.
    pub(super) fn make_flat(&mut self) {
        if let Some(FlatStart { x, p, .. }) = &self.flat_start {
            self.engine.put(&self.with_weights(x), p);
            self.is_current = false;
        }
    }

    /// Placed positions with the inverse masses that the vertices have now.
    fn with_weights(&self, x: &[Vec4]) -> Vec<Vec4> {
        x.iter().zip(&self.cloth.rest).map(|(x, rest)| x.with_w(rest.w)).collect()
    }
}

/// A number from -1 to 1 for each vertex that follows no pattern of the mesh (multiplicative hashing).
fn noise(vertex: u32) -> f64 {
    let mixed = vertex.wrapping_mul(0x9e37_79b9).rotate_left(16).wrapping_mul(0x85eb_ca6b);
    f64::from(mixed) / f64::from(u32::MAX) * 2.0 - 1.0
}
