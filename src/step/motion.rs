//! The end of the last step, from which the next one goes on.

use glam::{Vec3, Vec4};

use crate::attributes::{Collider, Shape, invalid};
use crate::error::StepError;
use crate::model::cloth::Cloth;
use crate::record::recorded;

/// What the next step must know about the last one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    /// Its substep (s). 0 if there was none; the first kick then lasts half a substep (leapfrog start).
    pub h: f32,
    /// Its colliders, from which those of the next step move; empty if the state was set.
    pub colliders: Vec<Collider>,
    /// Positions of the pins at its end (m), in local coordinates.
    pub pins: Vec<Vec3>,
    /// Velocities (m/s) at which the pins were led; empty if they followed no targets.
    pub pin_velocities: Vec<Vec3>,
}

recorded!(Motion { h, colliders, pins, pin_velocities });

impl Motion {
    /// After a state in the cloth's order, reached by substeps of `h` (s); 0 if the state was set.
    pub(crate) fn after(cloth: &Cloth, x: &[Vec4], h: f32) -> Motion {
        let pins = cloth.pinned.iter().map(|&vertex| x[vertex as usize].truncate()).collect();
        Motion { h, pins, ..Motion::default() }
    }

    /// Pairs each collider with the one it moves from: itself if it is new, was teleported or has another kind of
    /// shape. Colliders are matched by id; those without one by their order, if their kinds are the same in both lists and
    /// nothing looks like another order.
    pub(crate) fn followed<'a>(&'a self, colliders: &'a [Collider]) -> impl Iterator<Item = (&'a Collider, &'a Collider)> {
        let unnamed = |list: &'a [Collider]| list.iter().filter(|collider| collider.id.is_none());
        let mut last_unnamed = are_in_order(unnamed(&self.colliders), unnamed(colliders)).then(|| unnamed(&self.colliders));
        colliders.iter().map(move |now| {
            let last = match now.id {
                Some(_) => self.colliders.iter().find(|last| last.id == now.id),
                None => last_unnamed.as_mut().and_then(Iterator::next),
            };
            (now, last.filter(|last| !now.teleported && last.is_followed_by(now)).unwrap_or(now))
        })
    }

    /// Checks that a mesh collider known from the last step still has the same triangles.
    pub(crate) fn check(&self, colliders: &[Collider]) -> Result<(), StepError> {
        let has_others = |(index, now): (usize, &Collider)| {
            let last = self.colliders.iter().find(|last| now.id.is_some() && last.id == now.id)?;
            let is_other = !now.teleported && !last.is_followed_by(now) && matches!(now.shape, Shape::Mesh { .. });
            is_other.then(|| {
                let remedy = "are not those that it had in the last step; give it another id, or say that it was teleported";
                invalid(format_args!("colliders[{index}].mesh"), "its triangles", remedy)
            })
        };
        colliders.iter().enumerate().find_map(has_others).map_or(Ok(()), Err)
    }

    /// Records the targets that the pins were led to in a step of `dt` (s).
    pub(crate) fn led(&mut self, cloth: &Cloth, targets: Option<&[Vec3]>, dt: f32) {
        self.pin_velocities.clear();
        for (pin, target) in self.pins.iter_mut().zip(targets.unwrap_or_default()) {
            let to = *target - cloth.origin;
            self.pin_velocities.push((to - *pin) / dt);
            *pin = to;
        }
    }

    /// The time (s) that displacements are divided by to give velocities: the substep, or 1 for a state whose
    /// velocities were set.
    pub(crate) fn unit(&self) -> f32 {
        if self.h > 0.0 { self.h } else { 1.0 }
    }
}

/// Whether colliders can be matched by their order: their kinds agree, and no two of a kind that moved would have moved
/// less if each were the other.
fn are_in_order<'a>(last: impl Iterator<Item = &'a Collider> + Clone, now: impl Iterator<Item = &'a Collider> + Clone) -> bool {
    let kind = |collider: &Collider| std::mem::discriminant(&collider.shape);
    if !last.clone().map(kind).eq(now.clone().map(kind)) {
        return false;
    }
    let moved: Vec<_> = last.zip(now).filter(|(last, now)| last.distance_to(now) > 0.0).collect();
    moved.iter().enumerate().all(|(index, (last, now))| {
        moved[..index].iter().filter(|(other, _)| kind(other) == kind(last)).all(|(other_last, other_now)| {
            let exchanged = last.distance_to(other_now) + other_last.distance_to(now);
            // A row of colliders that move by more than their distance ties, but for rounding.
            exchanged >= 0.999 * (last.distance_to(now) + other_last.distance_to(other_now))
        })
    })
}

#[cfg(test)]
#[path = "../../tests/unit/step_motion.rs"]
mod tests;
