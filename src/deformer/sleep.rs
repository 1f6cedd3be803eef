//! Sleep: a cloth that has come to rest is not stepped until something changes.

use glam::Vec3;

use super::Deformer;
use crate::attributes::Attributes;
use crate::kernels::statistics::Statistics;
use crate::record::recorded;

/// How long a cloth has been still, and under which attributes.
#[derive(Debug, Clone, Default)]
pub(super) struct Stillness {
    /// The attributes of the last step.
    attributes: Attributes,
    /// Time (s) for which the attributes have not changed and the cloth has hardly moved; after a change, less by that of the steps
    /// before it whose statistics are still to come.
    time: f32,
}

recorded!(Stillness { attributes, time });

impl Deformer {
    /// Whether the cloth sleeps through a step under `attributes`.
    pub(super) fn sleeps(&self, attributes: &Attributes) -> bool {
        let Some(sleep) = self.options.sleep else { return false };
        self.state.still.time > sleep.after && self.state.still.attributes == *attributes
    }

    /// Records a step of `dt` (s) and whether the cloth moved in it.
    pub(super) fn watch_for_sleep(&mut self, dt: f32, attributes: &Attributes, seen: Option<&Statistics>) {
        let Some(sleep) = self.options.sleep else { return };
        let late = self.late();
        // Without pins, speeds are counted relative to the course.
        let travels = self.state.motion.course_of_free(&self.cloth) != Vec3::ZERO;
        let moves =
            |seen: &Statistics| travels || seen.rms_speed() > sleep.mean_speed || f32::from_bits(seen.fastest) > sleep.speed;
        let Stillness { attributes: last, time } = &mut self.state.still;
        *time = match last == attributes {
            true if seen.is_none_or(moves) => time.min(0.0),
            true => *time + dt,
            false => 0.0 - late,
        };
        if last != attributes {
            // The lists keep their memory, because a step must not allocate.
            let mut colliders = std::mem::take(&mut last.colliders);
            colliders.clone_from(&attributes.colliders);
            let mut pin_targets = last.pin_targets.take();
            match (&mut pin_targets, &attributes.pin_targets) {
                (Some(to), Some(from)) => to.clone_from(from),
                (to, from) => to.clone_from(from),
            }
            *last = Attributes { colliders, pin_targets, ..*attributes };
        }
    }

    /// Wakes the cloth.
    pub(super) fn wake(&mut self) {
        self.state.still.time = 0.0 - self.late();
    }

    /// The duration (s) of the steps whose statistics have not arrived: on a GPU the last three.
    pub(super) fn late(&self) -> f32 {
        self.state.awaiting_statistics.iter().map(|step| step.dt).fold(0.0, |sum, dt| sum + dt)
    }
}
