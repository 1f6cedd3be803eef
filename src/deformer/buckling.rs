//! The kick without which cloth that lies flat, and is pushed together there, could not buckle.

use glam::{Vec3, Vec4};

use crate::attributes::{Attributes, Collider, Shape};
use crate::deformer::imperfection::noise;
use crate::deformer::{Deformer, State};
use crate::error::StepError;
use crate::kernels::statistics::{Statistics, StrainGauge, WHOLE, is_crushed, unordered};
use crate::model::cloth::{Cloth, Panels};
use crate::record::recorded;

/// Share of the area from which on crushed cloth is looked for.
const CRUSHED_AREA: u32 = WHOLE / 512;
/// Most steps between two looks for it, of which each waits for the state: crushed edges are mostly in folds, where no kick is needed.
const LONGEST_PAUSE: u32 = 63;
/// How high a kick throws a vertex under standard gravity (m/s²), as a share of the mean edge.
const KICK: f32 = 0.003;
const STANDARD_GRAVITY: f32 = 9.80665;
/// Least length of the mean of the unit normals of the triangles at a vertex, where cloth counts as flat: they differ by a degree.
const FLAT: f32 = 1.0 - 1e-4;

/// How far cloth may be from what it lies on, in mean edges.
const ON_GROUND: f32 = 0.5;

/// How long not to look for crushed cloth, because there was none that lies flat: steps between the last looks, and steps left.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Looks {
    pause: u32,
    left: u32,
}

recorded!(Looks { pause, left });

impl Deformer {
    /// Whether a step may push cloth together that lies in a plane and stays there: pins or colliders move, and there is level ground, or
    /// no gravity.
    pub(super) fn may_be_crushed(&self, attributes: &Attributes) -> bool {
        let Attributes { colliders, pin_targets, gravity, .. } = attributes;
        let has_moved = |(now, last): (&Collider, &Collider)| now.shape.mesh().is_none() && now.shape != last.shape;
        let is_led = || pin_targets.is_some() || self.state.motion.followed(colliders).any(has_moved);
        (*gravity == Vec3::ZERO || colliders.iter().any(has_flat_faces)) && is_led()
    }

    /// Kicks what is crushed in its plane out of it, before a step: cloth that lies on a floor, without thickness and perfectly flat, has no
    /// reason to rise when it is pushed together, and its own weight keeps it down. Wrinkles then grow by themselves. A kick
    /// reaches a few thousandths of an edge, and is a velocity, so that contact lets no vertex pass through another layer. Returns when to
    /// look again.
    pub(super) fn let_buckle(&mut self, attributes: &Attributes) -> Result<Looks, StepError> {
        let State { seen, looks, .. } = &self.state;
        let are_crushed = seen.as_ref().is_some_and(|seen| seen.crushed > CRUSHED_AREA && self.may_lie(seen));
        if !are_crushed || !self.may_be_crushed(attributes) {
            return Ok(Looks::default());
        }
        if looks.left > 0 {
            return Ok(Looks { left: looks.left - 1, ..*looks });
        }
        let pause = (2 * looks.pause + 1).min(LONGEST_PAUSE);
        self.refresh_positions()?;
        if self.crushed().next().is_none() {
            return Ok(Looks { pause, left: pause });
        }
        let mut p = Vec::new();
        self.engine.read(|_, now| p = now.to_vec()).map_err(|failure| self.failed(failure))?;
        let speed = (2.0 * STANDARD_GRAVITY * KICK * self.cloth.mean_edge).sqrt() * self.state.motion.unit();
        let mut kicked = p.clone();
        for (vertex, normal) in self.crushed() {
            // The number among the vertices with edges does not depend on those without.
            kicked[vertex] = p[vertex] + (normal * (speed * noise(vertex as u32) as f32)).extend(0.0);
        }
        self.engine.put_displacements(&kicked);
        (self.before_kick, self.is_current) = (Some(p), false);
        Ok(Looks::default())
    }

    /// Whether any of the cloth may lie on a plane or a box, by its bounding box, or it floats without gravity.
    fn may_lie(&self, seen: &Statistics) -> bool {
        let [low, high] = [seen.low, seen.high].map(|corner| unordered(corner) + self.cloth.origin);
        let reach = ON_GROUND * self.cloth.mean_edge;
        let is_near = |collider: &Collider| match collider.shape {
            Shape::Plane { normal, .. } => collider.distance(Vec3::select(normal.cmpgt(Vec3::ZERO), low, high)) < reach,
            Shape::RoundedBox { .. } => collider.distance(0.5 * (low + high)) < reach + 0.5 * low.distance(high),
            _ => false,
        };
        self.state.gravity == Vec3::ZERO || self.state.motion.colliders.iter().any(is_near)
    }

    /// The free ends of edges that are crushed, around which the cloth is flat and lies on a plane or a box, or floats without gravity,
    /// with its unit normal there; some of them several times.
    fn crushed(&self) -> impl Iterator<Item = (usize, Vec3)> {
        let (cloth, x) = (&self.cloth, &self.local);
        let at = |vertex: u32| x[vertex as usize].truncate();
        let is_short = move |gauge: &&StrainGauge| is_crushed(at(gauge.ends[0]).distance(at(gauge.ends[1])), gauge.inverse_rest);
        let ends = cloth.gauges().iter().filter(is_short).flat_map(|gauge| gauge.ends);
        let lies = move |&end: &u32| {
            let mut ground = self.state.motion.colliders.iter().filter(|collider| has_flat_faces(collider));
            let on = |collider: &Collider| collider.distance(at(end) + cloth.origin) < ON_GROUND * cloth.mean_edge;
            x[end as usize].w > 0.0 && (self.state.gravity == Vec3::ZERO || ground.any(on))
        };
        ends.filter(lies).filter_map(move |end| flat_normal(cloth, x, end).map(|normal| (end as usize, normal)))
    }

    /// Undoes [`Deformer::let_buckle`] after a step that failed.
    pub(super) fn undo_kick(&mut self) {
        if let Some(p) = self.before_kick.take() {
            self.engine.put_displacements(&p);
            self.is_current = false;
        }
    }
}

/// Whether a collider has flat faces, on which cloth can lie in a plane.
fn has_flat_faces(collider: &Collider) -> bool {
    matches!(collider.shape, Shape::Plane { .. } | Shape::RoundedBox { .. })
}

/// The unit normal of the cloth around a vertex, if it is flat there.
fn flat_normal(cloth: &Cloth, x: &[Vec4], vertex: u32) -> Option<Vec3> {
    let Panels { panels, around } = cloth.panels();
    let around = around.of(vertex);
    let sum = around.iter().fold(Vec3::ZERO, |sum, &triangle| {
        let [a, b, c] = panels[triangle as usize].corners.map(|vertex| x[vertex as usize].truncate());
        let normal = (b - a).cross(c - a).normalize_or_zero();
        // Triangles may be wound either way.
        sum + if normal.dot(sum) < 0.0 { -normal } else { normal }
    });
    (sum.length() > FLAT * around.len() as f32).then(|| sum.normalize_or_zero())
}
