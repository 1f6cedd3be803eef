//! What acts on the cloth during one step, sampled by the caller from anything that moves.

use std::fmt::Display;
use std::sync::Arc;

use glam::{DVec3, Quat, Vec3};

use crate::error::StepError;
use crate::limits::{MAX_POSITION, MAX_VERTICES};
use crate::model::mesh::Mesh;
use crate::record::{Recorded, Tape, Unreadable, recorded};

/// Everything outside the cloth that acts on it, sampled once a step.
///
/// The default is gravity alone, in vacuum, undamped. A term that is absent costs nothing. A plain struct, to be written with
/// `..Attributes::default()`, which the next version's fields do not break.
#[derive(Debug, Clone, PartialEq)]
pub struct Attributes {
    /// Gravity (m/s²).
    pub gravity: Vec3,
    /// Velocity of the air (m/s). It acts through `air_density` (per triangle) and `damping` (per vertex).
    pub wind: Vec3,
    /// Density of the air (kg/m³); 0: no air. 1.225 at sea level and 15 °C (ISO 2533).
    pub air_density: f32,
    /// Drag coefficient of a panel across the stream: 1.28 for a flat plate (NASA, "Shape Effects on Drag").
    pub drag: f32,
    /// Lift coefficient, at most `drag`, in the form of Keckeisen et al. 2004 ("Wind effects on cloth"), the lift across
    /// the stream in the plane of stream and normal. Equal to `drag` by default: as near as the form comes to a plate's
    /// pressure force at 45 degrees.
    pub lift: f32,
    /// Rate (1/s) at which a vertex's velocity tends to `wind`, whatever the triangles' shape: `dv/dt = -damping (v - wind)`.
    pub damping: f32,
    /// What the cloth rests on. A collider that moved since the last step moves evenly through this one; contact and
    /// friction see its velocity (a plane's normal turns at once). Colliders are resolved in the list's order: a vertex pinched between
    /// two may end inside the first.
    ///
    /// Which one of the last step a collider was is told by its [`id`](Collider::id). Those without one are told apart by their place among
    /// those without one, as long as these are as many and of the same shapes in the same order as in the last step; otherwise all of them
    /// arrive where they are, and move nothing: a collider that is left out for a frame does not lend its place, and a velocity, to the next.
    ///
    /// Round colliders, boxes with round edges among them, are held off by 1.2 times the sagitta `l²/8R` of the cloth's longest edge `l`, so
    /// that edges, not only vertices, stay outside; no edge longer than R is looked after so.
    pub colliders: Vec<Collider>,
    /// Where the pinned vertices are at the end of this step (m), in the order of
    /// [`Options::pinned`](crate::Options::pinned). They get there evenly. `None`: they stay where they are.
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

/// A body that the cloth cannot enter.
///
/// A plain struct, made by [`Collider::sphere`] and its like, or written with `..Collider::default()`, neither of which the next
/// version's fields break.
#[derive(Debug, Clone, PartialEq)]
pub struct Collider {
    /// Its surface.
    pub shape: Shape,
    /// Coulomb's coefficient of friction, 0 or above.
    pub friction: f32,
    /// The same number in every step, by which it is known from step to step whatever else is in the list; no two may have the same.
    /// `None`: known by its place (see [`Attributes::colliders`]).
    pub id: Option<u64>,
    /// It did not move here since the last step, it was put here, and so has no velocity in this step.
    pub teleported: bool,
}

/// The surface of a [`Collider`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Center (m).
        center: Vec3,
        /// Radius (m), above 0.
        radius: f32,
    },
    /// The half-space below a plane.
    Plane {
        /// A point of the plane (m).
        point: Vec3,
        /// Its normal, out of the solid; any length but 0.
        normal: Vec3,
    },
    /// All points within `radius` of the segment from `a` to `b`.
    Capsule {
        /// One end of the segment (m).
        a: Vec3,
        /// The other end of the segment (m).
        b: Vec3,
        /// Radius (m), above 0.
        radius: f32,
    },
    /// All balls whose centers are on the segment from `a` to `b` and whose radii go evenly from one end's to the other's: an upper arm, a
    /// skirt's hips, a bottle's neck.
    TaperedCapsule {
        /// One end of the segment (m).
        a: Vec3,
        /// Radius at `a` (m), above 0.
        radius_a: f32,
        /// The other end of the segment (m).
        b: Vec3,
        /// Radius at `b` (m), above 0.
        radius_b: f32,
    },
    /// A box with rounded edges and corners.
    RoundedBox {
        /// Center (m).
        center: Vec3,
        /// Half of its width, height and depth (m) along its own axes, edges included; each above 0.
        half: Vec3,
        /// What turns its own axes into the world's; any length but 0.
        rotation: Quat,
        /// Radius of its edges and corners (m), from 0 (sharp) to the least of `half`.
        radius: f32,
    },
    /// A surface of triangles, open or closed, which the cloth is held off from on both sides: see [`Collider::mesh`].
    Mesh {
        /// Its vertices where they are at the end of the step (m), and its triangles.
        mesh: Arc<Mesh>,
    },
}

impl Default for Collider {
    /// The floor: what is below y = 0; friction 0.3.
    fn default() -> Collider {
        Collider::plane(Vec3::ZERO, Vec3::Y)
    }
}

impl Collider {
    /// Friction of a collider made without a word about it.
    const FRICTION: f32 = 0.3;

    /// A sphere: center (m), radius (m); friction 0.3.
    #[must_use]
    pub fn sphere(center: Vec3, radius: f32) -> Collider {
        Collider::of(Shape::Sphere { center, radius })
    }

    /// A plane through `point` (m) with `normal` out of the solid; friction 0.3.
    #[must_use]
    pub fn plane(point: Vec3, normal: Vec3) -> Collider {
        Collider::of(Shape::Plane { point, normal })
    }

    /// A capsule around the segment from `a` to `b` (m), radius (m); friction 0.3.
    #[must_use]
    pub fn capsule(a: Vec3, b: Vec3, radius: f32) -> Collider {
        Collider::of(Shape::Capsule { a, b, radius })
    }

    /// A capsule with two radii (m), `ra` around `a` (m) and `rb` around `b` (m); friction 0.3.
    #[must_use]
    pub fn tapered_capsule(a: Vec3, ra: f32, b: Vec3, rb: f32) -> Collider {
        Collider::of(Shape::TaperedCapsule { a, radius_a: ra, b, radius_b: rb })
    }

    /// A box around `center` (m) that reaches as far as `half` (m) along its own axes, which `rotation` turns into the world's, with edges
    /// and corners rounded by `radius` (m), 0 for sharp ones; friction 0.3. It moves and turns evenly from step to step, by less than half
    /// a turn.
    #[must_use]
    pub fn rounded_box(center: Vec3, half: Vec3, rotation: Quat, radius: f32) -> Collider {
        Collider::of(Shape::RoundedBox { center, half, rotation, radius })
    }

    /// A mesh whose vertices are here at the end of the step (m); friction 0.3. Its triangles stay the same as long as it is known from step to
    /// step, by its [`id`](Collider::id) or place; its vertices may move as they like, and go straight ahead during the step.
    ///
    /// Cloth is held off from it by the thickness of [`Options::contact`](crate::Options::contact), or that of
    /// [`Contact::default`](crate::Contact) where the cloth has no contact with itself: from both sides, for a mesh has no inside, so thin parts
    /// and open ones hold as well; its edges and the cloth's as well as its vertices. Nothing comes through, if nothing does where it appears
    /// ([`Warning::BodyCrossings`](crate::Warning::BodyCrossings)) and what is led moves no faster than the substeps resolve
    /// ([`Warning::ContactOutruns`](crate::Warning::ContactOutruns)). Not on the GPU yet, where a step refuses it.
    ///
    /// The mesh of the last step is kept to see where it comes from: give a new one in each step in which it moves, the same `Arc` where it
    /// does not, which costs less.
    #[must_use]
    pub fn mesh(mesh: Arc<Mesh>) -> Collider {
        Collider::of(Shape::Mesh { mesh })
    }

    fn of(shape: Shape) -> Collider {
        Collider { shape, friction: Collider::FRICTION, id: None, teleported: false }
    }

    /// The same collider, known by `id` from step to step.
    #[must_use]
    pub fn with_id(self, id: u64) -> Collider {
        Collider { id: Some(id), ..self }
    }

    /// The same collider, put here in this step without a velocity.
    #[must_use]
    pub fn teleported(self) -> Collider {
        Collider { teleported: true, ..self }
    }

    /// The same collider with another coefficient of friction.
    #[must_use]
    pub fn with_friction(self, friction: f32) -> Collider {
        Collider { friction, ..self }
    }

    /// Signed distance (m) from the surface to `point` (m), negative inside. A mesh has no inside; of it all triangles are looked at.
    #[must_use]
    pub fn distance(&self, point: Vec3) -> f32 {
        self.depth_from(point.as_dvec3()) as f32
    }

    /// [`Collider::distance`] in double precision.
    pub(crate) fn depth_from(&self, x: DVec3) -> f64 {
        match self.shape {
            Shape::Sphere { center, radius } => x.distance(center.as_dvec3()) - f64::from(radius),
            Shape::Plane { point, normal } => normal.as_dvec3().normalize().dot(x - point.as_dvec3()),
            Shape::Capsule { a, b, radius } => {
                let (a, axis) = (a.as_dvec3(), (b - a).as_dvec3());
                let along = ((x - a).dot(axis) / axis.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                x.distance(a + along * axis) - f64::from(radius)
            }
            Shape::TaperedCapsule { a, radius_a, b, radius_b } => {
                let (a, axis, taper) = (a.as_dvec3(), (b - a).as_dvec3(), f64::from(radius_b) - f64::from(radius_a));
                let cone = axis.length_squared() - taper * taper;
                // Where one ball holds the other there is no cone between them.
                let along = if cone <= 0.0 {
                    f64::from(taper > 0.0)
                } else {
                    let along = (x - a).dot(axis) / axis.length_squared();
                    let across = x.distance(a + along * axis);
                    (along + across * taper / (cone * axis.length_squared()).sqrt()).clamp(0.0, 1.0)
                };
                x.distance(a + along * axis) - (f64::from(radius_a) + along * taper)
            }
            Shape::RoundedBox { center, half, rotation, radius } => {
                let local = rotation.as_dquat().normalize().inverse() * (x - center.as_dvec3());
                let beyond = local.abs() - (half.as_dvec3() - f64::from(radius));
                beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0) - f64::from(radius)
            }
            Shape::Mesh { ref mesh } => mesh.distance(x),
        }
    }

    /// Whether this may have moved to where another is: all may but a mesh, to one of other triangles.
    pub(crate) fn is_followed_by(&self, now: &Collider) -> bool {
        match (&self.shape, &now.shape) {
            (Shape::Mesh { mesh }, Shape::Mesh { mesh: now }) => mesh.has_triangles_of(now),
            (Shape::Mesh { .. }, _) | (_, Shape::Mesh { .. }) => false,
            _ => true,
        }
    }

    /// The same collider in coordinates that begin at `origin`, but for a mesh.
    pub(crate) fn relative_to(&self, origin: Vec3) -> Collider {
        let shape = match self.shape {
            Shape::Sphere { center, radius } => Shape::Sphere { center: center - origin, radius },
            Shape::Plane { point, normal } => Shape::Plane { point: point - origin, normal },
            Shape::Capsule { a, b, radius } => Shape::Capsule { a: a - origin, b: b - origin, radius },
            Shape::TaperedCapsule { a, radius_a, b, radius_b } => {
                Shape::TaperedCapsule { a: a - origin, radius_a, b: b - origin, radius_b }
            }
            Shape::RoundedBox { center, half, rotation, radius } => {
                Shape::RoundedBox { center: center - origin, half, rotation, radius }
            }
            // Its vertices are many: who takes them subtracts the origin.
            Shape::Mesh { ref mesh } => Shape::Mesh { mesh: Arc::clone(mesh) },
        };
        Collider { shape, ..*self }
    }
}

impl Attributes {
    /// Checks every value; `pins` is the number of pinned vertices.
    pub(crate) fn validate(&self, pins: usize) -> Result<(), StepError> {
        finite("gravity", self.gravity)?;
        finite("wind", self.wind)?;
        not_negative("air_density", self.air_density)?;
        not_negative("drag", self.drag)?;
        not_negative("lift", self.lift)?;
        not_negative("damping", self.damping)?;
        if self.lift > self.drag {
            return Err(invalid("lift", self.lift, format_args!("must not exceed drag = {}", self.drag)));
        }
        for (index, collider) in self.colliders.iter().enumerate() {
            collider.validate(index)?;
            let earlier = self.colliders[..index].iter().position(|other| other.id == collider.id);
            if let (Some(id), Some(earlier)) = (collider.id, earlier) {
                let remedy = format_args!("is the id of colliders[{earlier}] too; give each its own");
                return Err(invalid(format_args!("colliders[{index}].id"), id, remedy));
            }
        }
        let Some(targets) = &self.pin_targets else { return Ok(()) };
        if targets.len() != pins {
            return Err(StepError::PinTargets { given: targets.len(), pinned: pins });
        }
        targets.iter().enumerate().try_for_each(|(slot, &target)| finite(format_args!("pin_targets[{slot}]"), target))
    }
}

impl Collider {
    fn validate(&self, index: usize) -> Result<(), StepError> {
        let above_0 = |name: &str, radius: f32| match radius > 0.0 && radius.is_finite() {
            true => Ok(()),
            false => Err(invalid(format_args!("colliders[{index}].{name}"), radius, "must be finite and above 0 m")),
        };
        let positive = |radius: f32| above_0("radius", radius);
        not_negative(format_args!("colliders[{index}].friction"), self.friction)?;
        match self.shape {
            Shape::Sphere { center, radius } => {
                finite(format_args!("colliders[{index}].center"), center)?;
                positive(radius)
            }
            Shape::Plane { point, normal } => {
                finite(format_args!("colliders[{index}].point"), point)?;
                finite(format_args!("colliders[{index}].normal"), normal)?;
                match normal.as_dvec3().try_normalize() {
                    Some(_) => Ok(()),
                    None => Err(invalid(
                        format_args!("colliders[{index}].normal"),
                        normal,
                        "has no direction; give a vector out of the solid",
                    )),
                }
            }
            Shape::Capsule { a, b, radius } => {
                finite(format_args!("colliders[{index}].a"), a)?;
                finite(format_args!("colliders[{index}].b"), b)?;
                positive(radius)
            }
            Shape::TaperedCapsule { a, radius_a, b, radius_b } => {
                finite(format_args!("colliders[{index}].a"), a)?;
                finite(format_args!("colliders[{index}].b"), b)?;
                above_0("radius_a", radius_a)?;
                above_0("radius_b", radius_b)
            }
            Shape::RoundedBox { center, half, rotation, radius } => {
                finite(format_args!("colliders[{index}].center"), center)?;
                ["half.x", "half.y", "half.z"]
                    .into_iter()
                    .zip(half.to_array())
                    .try_for_each(|(name, half)| above_0(name, half))?;
                let square = rotation.as_dquat().length_squared();
                if !(square > 0.0 && square.is_finite()) {
                    let remedy = "has no direction; give a quaternion of finite numbers, Quat::IDENTITY for none";
                    return Err(invalid(format_args!("colliders[{index}].rotation"), rotation, remedy));
                }
                if !(0.0..=half.min_element()).contains(&radius) {
                    let remedy = format_args!("must be from 0 m to the least of half = {half}");
                    return Err(invalid(format_args!("colliders[{index}].radius"), radius, remedy));
                }
                Ok(())
            }
            Shape::Mesh { ref mesh } => validate_mesh(index, mesh),
        }
    }
}

fn validate_mesh(index: usize, mesh: &Mesh) -> Result<(), StepError> {
    let Mesh { positions, triangles } = mesh;
    if triangles.is_empty() {
        return Err(invalid(
            format_args!("colliders[{index}].mesh"),
            "a mesh without triangles",
            "has no surface; give it one, or leave it out",
        ));
    }
    if positions.len() > MAX_VERTICES {
        let remedy = format_args!("has more than {MAX_VERTICES}; split it");
        return Err(invalid(format_args!("colliders[{index}].mesh: vertices"), positions.len(), remedy));
    }
    let inside = |x: &Vec3| x.abs().cmple(Vec3::splat(MAX_POSITION)).all();
    if let Some(vertex) = positions.iter().position(|x| !inside(x)) {
        let name = format_args!("colliders[{index}].mesh.positions[{vertex}]");
        return Err(invalid(name, positions[vertex], "must be finite and within 1e15 m"));
    }
    let names_others = |triangle: &[u32; 3]| triangle.iter().any(|&vertex| vertex as usize >= positions.len());
    if let Some(triangle) = triangles.iter().position(names_others) {
        let name = format_args!("colliders[{index}].mesh.triangles[{triangle}]");
        let remedy = format_args!("names a vertex that it lacks: it has {}, numbered from 0", positions.len());
        return Err(invalid(name, format_args!("{:?}", triangles[triangle]), remedy));
    }
    Ok(())
}

pub(crate) fn invalid(name: impl Display, value: impl Display, remedy: impl Display) -> StepError {
    StepError::Attribute { name: name.to_string(), value: value.to_string(), remedy: remedy.to_string() }
}

fn finite(name: impl Display, value: Vec3) -> Result<(), StepError> {
    if value.is_finite() { Ok(()) } else { Err(invalid(name, value, "must be finite")) }
}

fn not_negative(name: impl Display, value: f32) -> Result<(), StepError> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { Err(invalid(name, value, "must be finite and 0 or above")) }
}

recorded!(Attributes { gravity, wind, air_density, drag, lift, damping, colliders, pin_targets });
recorded!(Collider { shape, friction, id, teleported });

impl Recorded for Shape {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let mut kind = match self {
            Shape::Sphere { .. } => 0_u8,
            Shape::Plane { .. } => 1,
            Shape::Capsule { .. } => 2,
            Shape::TaperedCapsule { .. } => 3,
            Shape::RoundedBox { .. } => 4,
            Shape::Mesh { .. } => 5,
        };
        kind.record(tape)?;
        if let Tape::In(_) = tape {
            let (zero, rotation, radius) = (Vec3::ZERO, Quat::IDENTITY, 0.0);
            *self = match kind {
                0 => Shape::Sphere { center: zero, radius },
                1 => Shape::Plane { point: zero, normal: zero },
                2 => Shape::Capsule { a: zero, b: zero, radius },
                3 => Shape::TaperedCapsule { a: zero, radius_a: radius, b: zero, radius_b: radius },
                4 => Shape::RoundedBox { center: zero, half: zero, rotation, radius },
                5 => Shape::Mesh { mesh: Arc::default() },
                _ => return Err(Unreadable),
            };
        }
        let parts: Vec<&mut dyn Recorded> = match self {
            Shape::Sphere { center, radius } => vec![center, radius],
            Shape::Plane { point, normal } => vec![point, normal],
            Shape::Capsule { a, b, radius } => vec![a, b, radius],
            Shape::TaperedCapsule { a, radius_a, b, radius_b } => vec![a, radius_a, b, radius_b],
            Shape::RoundedBox { center, half, rotation, radius } => vec![center, half, rotation, radius],
            Shape::Mesh { mesh } => vec![mesh],
        };
        parts.into_iter().try_for_each(|part| part.record(tape))
    }
}
