//! The imperfection without which flat cloth could not buckle.

use glam::{DVec3, Vec3, Vec4};

use crate::deformer::Deformer;
use crate::model::cloth::Cloth;
use crate::model::flat_parts::{FlatPart, flat_parts};

/// How far vertices are moved out of the plane: as a share of the part's size, and at least this multiple of the rounding
/// of its largest coordinate.
const IMPERFECTION: f64 = 1e-6;
const ROUNDINGS: f64 = 4.0;
/// A force that has a larger share than this across the plane or the line bends the cloth itself.
const ACROSS: f64 = 1e-6;

/// A state that the caller has placed, of which a part is flat, until a step begins from it.
pub(super) struct FlatStart {
    /// Positions, and the displacements with which they were placed; none for the mesh at rest.
    placed: Option<[Vec<Vec4>; 2]>,
    parts: Vec<FlatPart>,
}

impl FlatStart {
    /// Of the mesh at rest; none if no part of it is flat.
    pub(super) fn at_rest(cloth: &Cloth) -> Option<FlatStart> {
        let parts = flat_parts(&cloth.rest, cloth);
        (!parts.is_empty()).then_some(FlatStart { placed: None, parts })
    }

    /// Of positions and displacements; none if no part is flat.
    pub(super) fn placed(x: &[Vec4], p: &[Vec4], cloth: &Cloth) -> Option<FlatStart> {
        let parts = flat_parts(x, cloth);
        (!parts.is_empty()).then(|| FlatStart { placed: Some([x, p].map(<[Vec4]>::to_vec)), parts })
    }

    /// The positions, with the inverse masses that the vertices have now, and the displacements.
    fn state(&self, cloth: &Cloth) -> [Vec<Vec4>; 2] {
        let Some([x, p]) = &self.placed else { return [cloth.rest.clone(), vec![Vec4::ZERO; cloth.rest.len()]] };
        [x.iter().zip(&cloth.rest).map(|(x, rest)| x.with_w(rest.w)).collect(), p.clone()]
    }
}

impl Deformer {
    /// Before the first step from a placed state, moves the free vertices of exactly flat parts out of their plane (of straight threads off
    /// their line), each by up to a millionth of the part's size. Compression within the plane has no reason to bend such a part to one side
    /// rather than the other, so it would be crushed there, however far; real cloth is never that flat. Where gravity acts
    /// across the plane it bends the cloth by itself, unless that lies on something ([`Deformer::let_buckle`]), and without gravity
    /// hardly anything compresses it: nothing is moved.
    pub(super) fn make_imperfect(&mut self, gravity: Vec3) {
        let gravity = gravity.as_dvec3();
        let is_along = |part: &&FlatPart| {
            let across = part.line.map_or_else(|| gravity.dot(part.normal).abs(), |line| gravity.cross(line).length());
            gravity != DVec3::ZERO && across <= ACROSS * gravity.length()
        };
        let Some(start) = &self.flat_start else { return };
        let mut parts = start.parts.iter().filter(is_along).peekable();
        if parts.peek().is_none() {
            return;
        }
        let [mut x, p] = start.state(&self.cloth);
        for FlatPart { normal, vertices, extent, farthest, .. } in parts {
            let most = (IMPERFECTION * extent).max(ROUNDINGS * f64::from(f32::EPSILON) * farthest);
            for &vertex in vertices {
                let (x, name) = (&mut x[vertex as usize], self.cloth.order[vertex as usize]);
                if x.w > 0.0 {
                    *x += (normal * (most * noise(name))).as_vec3().extend(0.0);
                }
            }
        }
        self.engine.put(&x, &p);
        self.is_current = false;
    }

    /// Undoes [`Deformer::make_imperfect`] after a step that failed.
    pub(super) fn make_flat(&mut self) {
        if let Some(start) = &self.flat_start {
            let [x, p] = start.state(&self.cloth);
            self.engine.put(&x, &p);
            self.is_current = false;
        }
    }
}

/// A number from -1 to 1 for each vertex that follows no pattern of the mesh (multiplicative hashing).
pub(super) fn noise(vertex: u32) -> f64 {
    let mixed = vertex.wrapping_mul(0x9e37_79b9).rotate_left(16).wrapping_mul(0x85eb_ca6b);
    f64::from(mixed) / f64::from(u32::MAX) * 2.0 - 1.0
}
