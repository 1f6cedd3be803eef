//! The air: its velocity over time, including gusts.

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, UpAxis};

use super::file::{Gusts, Wind};
use super::keys::Animated;
use super::timeline::Moment;

/// Density of the air at sea level and 15 °C (kg/m³) (ISO 2533).
const AIR: f32 = 1.225;

impl Wind {
    /// Air with a constant velocity (m/s).
    pub(super) fn steady(velocity: Vec3) -> Wind {
        Wind { velocity: Animated::still(velocity), density: None, drag: None, lift: None, damping: None, gusts: None }
    }

    /// The attributes with the air at a moment; gusts turn about the scene's vertical.
    pub(super) fn blow(&self, moment: Moment, up: UpAxis, attributes: Attributes) -> Attributes {
        let Wind { velocity, density, drag, lift, damping, gusts } = self;
        let velocity = velocity.at(moment);
        let drag = drag.map_or(attributes.drag, |drag| drag.0);
        Attributes {
            wind: gusts.as_ref().map_or(velocity, |gusts| gusts.of(velocity, moment.time, up)),
            air_density: density.map_or(AIR, |density| density.0),
            drag,
            lift: lift.map_or(drag, |lift| lift.0),
            damping: damping.map_or(0.0, |damping| damping.0),
            ..attributes
        }
    }
}

impl Gusts {
    /// A velocity (m/s) modified by the gusts at `time` (s).
    fn of(&self, velocity: Vec3, time: f64, up: UpAxis) -> Vec3 {
        let at = time / f64::from(self.period.map_or(1.0, |period| period.0));
        let swell = 1.0 + self.strength.0 * noise(self.seed, 0, at);
        let turn = self.turn.map_or(0.0, |turn| turn.0) * noise(self.seed, 1, at);
        Quat::from_axis_angle(up.turn(Vec3::Y), turn.to_radians()) * velocity * swell
    }
}

/// Smooth noise from -1 to 1: random values at integers, interpolated smoothly, plus half of the same at twice the
/// frequency.
fn noise(seed: u32, channel: u64, at: f64) -> f32 {
    let by_chance = |place: u64| {
        let key = u64::from(seed) << 32 ^ channel << 60 ^ place;
        2.0 * fastrand::Rng::with_seed(key).f64() - 1.0
    };
    let octave = |at: f64, first: u64| {
        let (place, s) = (at.floor(), at - at.floor());
        let [from, to] = [place, place + 1.0].map(|place| by_chance(first.wrapping_add(place as u64)));
        from + (to - from) * s * s * (3.0 - 2.0 * s)
    };
    ((octave(at, 0) + 0.5 * octave(2.0 * at, 1 << 31)) / 1.5) as f32
}
