//! The imperfections without which flat cloth could not buckle.

use glam::{DVec3, Vec3, Vec4};

use crate::attributes::{Attributes, Collider, Shape};
use crate::deformer::Deformer;
use crate::error::StepError;
use crate::kernels::statistics::{StrainGauge, WHOLE, is_crushed};
use crate::model::cloth::Cloth;
use crate::model::flat_parts::{FlatPart, flat_parts};

/// How far vertices are moved out of the plane: as a share of the part's size, and at least this multiple of the rounding
/// of its largest coordinate.
const IMPERFECTION: f64 = 1e-6;
const ROUNDINGS: f64 = 4.0;
/// A force that has a larger share than this across the plane bends the cloth itself.
const ACROSS: f64 = 1e-6;

/// Share of the area from which on crushed cloth is looked for.
const CRUSHED_AREA: u32 = WHOLE / 512;
/// How high a kick throws a vertex under standard gravity (m/s²), as a share of the mean edge.
const KICK: f32 = 0.003;
const STANDARD_GRAVITY: f32 = 9.80665;
/// Least length of the mean of the unit normals of the triangles at a vertex, where cloth counts as flat: they differ by a degree.
const FLAT: f32 = 1.0 - 1e-4;

/// A state that the caller has placed, of which a part is flat, until a step begins from it.
#[derive(Debug)]
pub(super) struct FlatStart {
    /// Positions, and the displacements with which they were placed; none for the mesh at rest.
    placed: Option<[Vec<Vec4>; 2]>,
    parts: Vec<FlatPart>,
}

impl FlatStart {
    /// Of the mesh at rest; none if no part of it is flat.
    pub(super) fn at_rest(cloth: &Cloth) -> Option<FlatStart> {
        let parts = flat_parts(&cloth.rest, &cloth.triangles);
        (!parts.is_empty()).then_some(FlatStart { placed: None, parts })
    }

    /// Of positions and displacements; none if no part is flat.
    pub(super) fn placed(x: &[Vec4], p: &[Vec4], cloth: &Cloth) -> Option<FlatStart> {
        let parts = flat_parts(x, &cloth.triangles);
        (!parts.is_empty()).then(|| FlatStart { placed: Some([x, p].map(<[Vec4]>::to_vec)), parts })
    }

    /// The positions, with the inverse masses that the vertices have now, and the displacements.
    fn state(&self, cloth: &Cloth) -> [Vec<Vec4>; 2] {
        let Some([x, p]) = &self.placed else { return [cloth.rest.clone(), vec![Vec4::ZERO; cloth.rest.len()]] };
        [x.iter().zip(&cloth.rest).map(|(x, rest)| x.with_w(rest.w)).collect(), p.clone()]
    }
}

impl Deformer {
    /// Before the first step from a placed state, moves the free vertices of exactly flat parts out of their plane, each
    /// by up to a millionth of the part's size. Compression within the plane has no reason to bend such a part to one side
    /// rather than the other, so it would be crushed there, however far; real cloth is never that flat. Where gravity acts
    /// across the plane it bends the cloth by itself, unless that lies on something ([`Deformer::let_buckle`]), and without gravity
    /// hardly anything compresses it: nothing is moved.
    pub(super) fn make_imperfect(&mut self, gravity: Vec3) {
        let gravity = gravity.as_dvec3();
        let is_along = |part: &&FlatPart| gravity != DVec3::ZERO && gravity.dot(part.normal).abs() <= ACROSS * gravity.length();
        let Some(start) = &self.flat_start else { return };
        let mut parts = start.parts.iter().filter(is_along).peekable();
        if parts.peek().is_none() {
            return;
        }
        let [mut x, p] = start.state(&self.cloth);
        for FlatPart { normal, vertices, extent, farthest } in parts {
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

impl Deformer {
    /// Whether a step may push cloth together that lies in a plane and stays there: pins or colliders move, and there is level ground, or
    /// no gravity.
    pub(super) fn may_be_crushed(&self, attributes: &Attributes) -> bool {
        let Attributes { colliders, pin_targets, gravity, .. } = attributes;
        let is_level = |collider: &Collider| matches!(collider.shape, Shape::Plane { .. } | Shape::RoundedBox { .. });
        let has_moved = |(now, last): (&Collider, &Collider)| !matches!(now.shape, Shape::Mesh { .. }) && now.shape != last.shape;
        let is_led = || pin_targets.is_some() || self.state.motion.followed(colliders).any(has_moved);
        (*gravity == Vec3::ZERO || colliders.iter().any(is_level)) && is_led()
    }

    /// Kicks what is crushed in its plane out of it, before a step: cloth that lies on a floor, without thickness and perfectly flat, has no
    /// reason to rise when it is pushed together, and its own weight keeps it down. Wrinkles then grow by themselves. A kick
    /// reaches a few thousandths of an edge, and is a velocity, so that contact lets no vertex pass through another layer.
    pub(super) fn let_buckle(&mut self, attributes: &Attributes) -> Result<(), StepError> {
        let are_crushed = self.state.seen.as_ref().is_some_and(|seen| seen.crushed > CRUSHED_AREA);
        if !are_crushed || !self.may_be_crushed(attributes) {
            return Ok(());
        }
        self.refresh_positions()?;
        let mut p = Vec::new();
        self.engine.read(|_, now| p = now.to_vec()).map_err(|failure| self.failed(failure))?;
        let speed = (2.0 * STANDARD_GRAVITY * KICK * self.cloth.mean_edge).sqrt();
        let (mut kicked, mut are_kicked) = (p.clone(), false);
        for (vertex, normal) in crushed(&self.cloth, &self.local) {
            let by = normal * (speed * self.state.motion.unit() * noise(self.cloth.order[vertex]) as f32);
            kicked[vertex] += by.extend(0.0);
            are_kicked = true;
        }
        if are_kicked {
            self.engine.put_displacements(&kicked);
            (self.before_kick, self.is_current) = (Some(p), false);
        }
        Ok(())
    }

    /// Undoes [`Deformer::let_buckle`] after a step that failed.
    pub(super) fn undo_kick(&mut self) {
        if let Some(p) = self.before_kick.take() {
            self.engine.put_displacements(&p);
            self.is_current = false;
        }
    }
}

/// The free vertices at `x` (m) with an edge that is crushed and around which the cloth is flat, with its unit normal there.
fn crushed(cloth: &Cloth, x: &[Vec4]) -> Vec<(usize, Vec3)> {
    let at = |vertex: u32| x[vertex as usize].truncate();
    let mut at_crushed = vec![false; x.len()];
    for &StrainGauge { ends: [a, b], inverse_rest, .. } in cloth.gauges() {
        if is_crushed(at(a).distance(at(b)), inverse_rest) {
            (at_crushed[a as usize], at_crushed[b as usize]) = (true, true);
        }
    }
    let mut normals = vec![(Vec3::ZERO, 0.0); x.len()];
    for triangle in &cloth.triangles {
        let [a, b, c] = triangle.map(at);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for vertex in triangle {
            // Triangles may be wound either way.
            let (sum, count) = &mut normals[*vertex as usize];
            *sum += if normal.dot(*sum) < 0.0 { -normal } else { normal };
            *count += 1.0;
        }
    }
    let is_flat = |vertex: &usize| normals[*vertex].0.length() > FLAT * normals[*vertex].1;
    let vertices = (0..x.len()).filter(|&vertex| at_crushed[vertex] && x[vertex].w > 0.0).filter(is_flat);
    vertices.map(|vertex| (vertex, normals[vertex].0.normalize_or_zero())).collect()
}

/// A number from -1 to 1 for each vertex that follows no pattern of the mesh (multiplicative hashing).
fn noise(vertex: u32) -> f64 {
    let mixed = vertex.wrapping_mul(0x9e37_79b9).rotate_left(16).wrapping_mul(0x85eb_ca6b);
    f64::from(mixed) / f64::from(u32::MAX) * 2.0 - 1.0
}
