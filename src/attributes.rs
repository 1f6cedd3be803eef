//! What acts on the cloth during one step: gravity, air, colliders and moving pins.

use std::fmt::Display;
use std::sync::Arc;

use glam::{DVec3, Quat, Vec3};

use crate::error::StepError;
use crate::limits::{MAX_POSITION, MAX_VERTICES};
use crate::model::mesh::Mesh;
use crate::record::{Recorded, Tape, Unreadable, recorded};

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
    /// this step, and contact and friction take that velocity into account (only a plane's normal changes at once).
    /// Colliders are resolved in the order of the list, so a vertex pinched between two may end up inside the first.
    ///
    /// A collider with an [`id`](Collider::id) is matched with the one that had the same id in the last step. Colliders
    /// without an id are matched by their order among themselves, if their number and their shapes in order are the
    /// same as in the last step. Otherwise all of them are taken as new and have no velocity, so that removing one from
    /// the list does not give its position, and thus a false velocity, to the next.
    ///
    /// Round colliders, including boxes with rounded edges, are enlarged by 1.2 times the sagitta `l²/8R`, where `l` is
    /// the longest edge of the cloth, so that edges stay outside and not only vertices. Edges longer than R count as R.
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

/// A body that the cloth cannot enter.
///
/// Create one with [`Collider::sphere`] and the like, or write `Collider { .., ..Collider::default() }`, so that fields
/// added later do not break your code.
#[derive(Debug, Clone, PartialEq)]
pub struct Collider {
    /// The surface of the body.
    pub shape: Shape,
    /// Coefficient of Coulomb friction, 0 or above.
    pub friction: f32,
    /// A number that identifies this collider from step to step, whatever else is in the list; no two colliders may
    /// have the same. `None`: it is matched by its order (see [`Attributes::colliders`]).
    pub id: Option<u64>,
    /// The collider was placed here rather than moved here since the last step, and therefore has no velocity in this
    /// step.
    pub teleported: bool,
}

/// The surface of a [`Collider`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Shape {
    /// A solid sphere.
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
        /// The plane's normal, pointing out of the solid; any length but 0.
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
    /// All spheres whose centers are on the segment from `a` to `b` and whose radii change linearly from one end to the
    /// other: an upper arm, the hips under a skirt, the neck of a bottle.
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
        /// Half of its width, height and depth (m) along its own axes, including the rounded edges; each above 0.
        half: Vec3,
        /// Rotation from its own axes to the world's; any length but 0.
        rotation: Quat,
        /// Radius of its edges and corners (m), from 0 (sharp) to the smallest component of `half`.
        radius: f32,
    },
    /// A surface of triangles, open or closed, which repels the cloth from both sides: see [`Collider::mesh`].
    Mesh {
        /// Its triangles, and the positions of its vertices at the end of the step (m).
        mesh: Arc<Mesh>,
    },
}

impl Default for Collider {
    /// The floor: everything below y = 0; friction 0.3.
    fn default() -> Collider {
        Collider::plane(Vec3::ZERO, Vec3::Y)
    }
}

impl Collider {
    /// Friction of colliders from the constructors.
    const FRICTION: f32 = 0.3;

    /// A sphere: center (m), radius (m); friction 0.3.
    #[must_use]
    pub fn sphere(center: Vec3, radius: f32) -> Collider {
        Collider::of(Shape::Sphere { center, radius })
    }

    /// The half-space below the plane through `point` (m) with `normal` pointing out of the solid; friction 0.3.
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

    /// A box around `center` (m) that extends by `half` (m) along its own axes, which `rotation` turns into the
    /// world's. Edges and corners are rounded by `radius` (m), 0 for sharp ones; friction 0.3. It moves and turns at
    /// constant speed between steps, by less than half a turn.
    #[must_use]
    pub fn rounded_box(center: Vec3, half: Vec3, rotation: Quat, radius: f32) -> Collider {
        Collider::of(Shape::RoundedBox { center, half, rotation, radius })
    }

    /// A mesh with its vertices where they are at the end of the step (m); friction 0.3. Vertices may move freely from
    /// step to step, and move in straight lines during a step. The triangles must stay the same as long as the collider
    /// is matched from step to step, by its [`id`](Collider::id) or its order.
    ///
    /// The cloth is kept at the thickness of [`Options::contact`](crate::Options::contact), or that of
    /// [`Contact::default`](crate::Contact) if the cloth has no contact with itself. A mesh has no inside: it repels
    /// the cloth from both sides, so thin and open parts work as well, and edges are held as well as vertices. Nothing
    /// passes through, provided that nothing crosses where the mesh first appears
    /// ([`Warning::BodyCrossings`](crate::Warning::BodyCrossings)) and that pins and meshes move no faster than the
    /// substeps resolve ([`Warning::ContactOutruns`](crate::Warning::ContactOutruns)). Mesh colliders run on the CPU
    /// only; with `Backend::Gpu` the step returns an error.
    ///
    /// The mesh of the last step is kept to know where each vertex comes from. Pass a new mesh in each step in which it
    /// moves, and the same `Arc` while it stands still, which is cheaper.
    #[must_use]
    pub fn mesh(mesh: Arc<Mesh>) -> Collider {
        Collider::of(Shape::Mesh { mesh })
    }

    fn of(shape: Shape) -> Collider {
        Collider { shape, friction: Collider::FRICTION, id: None, teleported: false }
    }

    /// The same collider with an `id` by which it is matched from step to step.
    #[must_use]
    pub fn with_id(self, id: u64) -> Collider {
        Collider { id: Some(id), ..self }
    }

    /// The same collider, placed here in this step without a velocity.
    #[must_use]
    pub fn teleported(self) -> Collider {
        Collider { teleported: true, ..self }
    }

    /// The same collider with another coefficient of friction.
    #[must_use]
    pub fn with_friction(self, friction: f32) -> Collider {
        Collider { friction, ..self }
    }

    /// Signed distance (m) from the surface to `point` (m), negative inside. A mesh has no inside, and each call visits
    /// all of its triangles.
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
                // One sphere contains the other: the surface is that of the larger sphere.
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

    /// Whether this collider may have moved to where `now` is. Everything may but a mesh whose triangles changed.
    pub(crate) fn is_followed_by(&self, now: &Collider) -> bool {
        match (&self.shape, &now.shape) {
            (Shape::Mesh { mesh }, Shape::Mesh { mesh: now }) => mesh.has_triangles_of(now),
            (Shape::Mesh { .. }, _) | (_, Shape::Mesh { .. }) => false,
            _ => true,
        }
    }

    /// The same collider in coordinates relative to `origin`; a mesh is returned unchanged.
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
            // A mesh has many vertices, so whoever reads them subtracts the origin.
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
        let remedy = format_args!("is more than {MAX_VERTICES}; split the mesh");
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
        let remedy = format_args!("refers to a vertex that does not exist; the mesh has {}, numbered from 0", positions.len());
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
