//! What acts on the cloth during one step: gravity, air, colliders and moving pins.

mod checks;
mod collider;

pub(crate) use checks::invalid;
pub use collider::{Collider, Shape};

use glam::Vec3;

use crate::record::recorded;

/// Everything outside the cloth that acts on it, passed anew to every step.
///
/// The default is gravity alone: no air, no damping, no colliders. An absent term costs nothing. Write
/// `Attributes { .., ..Attributes::default() }`, so that fields added later do not break your code.
#[derive(Debug, Clone, PartialEq)]
pub struct Attributes {
    /// Gravity (m/s²).
    pub gravity: Vec3,
    /// Velocity of the air (m/s). It acts on triangles through `air_density` and on vertices through `damping`.
    pub wind: Vec3,
    /// Density of the air (kg/m³); 0: no air. 1.225 at sea level and 15 °C (ISO 2533).
    pub air_density: f32,
    /// Drag coefficient of a panel perpendicular to the flow: 1.28 for a flat plate (NASA, "Shape Effects on Drag").
    pub drag: f32,
    /// Lift coefficient, at most `drag`. The lift acts perpendicular to the flow, in the plane of the flow and the
    /// triangle's normal (Keckeisen et al. 2004, "Wind effects on cloth"). By default it equals `drag`, which in this
    /// model comes closest to the pressure force on a plate at 45 degrees.
    pub lift: f32,
    /// Rate (1/s) at which each vertex's velocity approaches `wind`, independent of the triangles' orientation:
    /// `dv/dt = -damping (v - wind)`.
    pub damping: f32,
    /// Bodies that the cloth cannot enter. A collider that moved since the last step moves at constant velocity through
    /// this step, and contact and friction take that velocity into account. Where its velocity changes by `dv` from step to step along a
    /// straight line, cloth that lies on it slips by `dv²/(2 mu g)` each time: by 15 to 19 mm in a second at 60 steps per second where it
    /// accelerates by 2.6 m/s², nine tenths of what a friction of .3 can hold.
    ///
    /// Colliders are resolved in the order of the list, so a vertex that two squeeze may end up inside the first. It sticks to the
    /// one with more friction, whatever presses them together (between two with the same, it goes half of each way), unless it slips
    /// out between surfaces that meet at more than the angle of friction: so a gripper's fingers, which overlap a little, lift a
    /// towel. (This is of spheres, capsules, boxes and planes; a mesh presses as its triangles do.)
    ///
    /// A collider with an [`id`](Collider::id) is matched with the one that had the same id in the last step. Colliders
    /// without an id are matched by their order among themselves, if their number and their shapes in order are the
    /// same as in the last step, and no two of the same shape would have moved less by changing places. Otherwise all of
    /// them are taken as new and have no velocity, so that removing one from the list or changing its order does not give
    /// its position, and thus a false velocity, to another.
    ///
    /// Round colliders, including boxes with rounded edges, are enlarged by 1.2 times the sagitta `l²/8R`, where `l` is
    /// the longest edge of the cloth, so that edges stay outside and not only vertices. Edges longer than R count as R.
    /// Cloth that starts within that distance rises to the larger surface at 5 cm/s, which adds no velocity, and slides by what it needs
    /// to lie around it.
    pub colliders: Vec<Collider>,
    /// Positions of the pinned vertices at the end of this step (m), in the order of
    /// [`Options::pinned`](crate::Options::pinned). The pins move there at constant velocity. `None`: they do not move.
    pub pin_targets: Option<Vec<Vec3>>,
}

impl Default for Attributes {
    fn default() -> Attributes {
        Attributes {
            gravity: Vec3::new(0.0, -9.81, 0.0),
            wind: Vec3::ZERO,
            air_density: 0.0,
            drag: 1.28,
            lift: 1.28,
            damping: 0.0,
            colliders: Vec::new(),
            pin_targets: None,
        }
    }
}

recorded!(Attributes { gravity, wind, air_density, drag, lift, damping, colliders, pin_targets });
