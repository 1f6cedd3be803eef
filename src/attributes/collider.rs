//! Bodies that the cloth cannot enter.

use std::mem::discriminant;
use std::sync::Arc;

use glam::{DVec3, Quat, Vec3};

use crate::model::mesh::Mesh;
use crate::record::{Recorded, Tape, Unreadable, recorded};

/// A body that the cloth cannot enter.
///
/// Create one with [`Collider::sphere`] and the like, or write `Collider { .., ..Collider::default() }`, so that fields
/// added later do not break your code.
#[derive(Debug, Clone, PartialEq)]
pub struct Collider {
    /// The surface of the body.
    pub shape: Shape,
    /// Coefficient of Coulomb friction between this collider and the cloth, 0 or above. It is not combined with any other; what two
    /// colliders squeeze sticks to the one with more.
    pub friction: f32,
    /// A number that identifies this collider from step to step, whatever else is in the list; no two colliders may
    /// have the same. `None`: it is matched by its order (see [`Attributes::colliders`](crate::Attributes::colliders)).
    pub id: Option<u64>,
    /// The collider was placed here rather than moved here since the last step, and therefore has no velocity in this
    /// step.
    pub teleported: bool,
}

/// The surface of a [`Collider`].
///
/// What a parameter changes by in a step is motion, which friction passes on, even where the surface stays as it is: a plane whose point
/// moves within it drags the cloth that lies on it, and a capsule whose ends are exchanged turns over. Keep such a parameter, or say that
/// the collider was [`teleported`](Collider::teleported).
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
    ///
    /// Along edges that are sharper than the cloth's edges are long, friction fades within 1.5 times the mean of these (at most a
    /// quarter of the box's second longest side): cloth that is pulled around such an edge would get stuck there. Cloth with bending
    /// stiffness does all the same, with more than half of it hanging down, so where cloth is to slide off give `radius` at least half the
    /// length of its edges. A box knows no others, so this is also the case along the seam of boxes whose sides meet. Where their faces
    /// are level, cloth lies on and slides over such a seam as over one face, but for this friction.
    #[must_use]
    pub fn rounded_box(center: Vec3, half: Vec3, rotation: Quat, radius: f32) -> Collider {
        Collider::of(Shape::RoundedBox { center, half, rotation, radius })
    }

    /// A mesh with its vertices where they are at the end of the step (m); friction 0.3. Vertices may move freely from
    /// step to step, and move in straight lines during a step. Where they turn, their velocity changes by `dv` from step to step, at once,
    /// and cloth on them slips by about `dv²/(2 mu g)` each time: by 11 mm a second at 60 steps per second, 0.5 m from the middle of a
    /// turntable of 2 rad/s with friction 0.3, and by half of that at 120. On a box, which turns evenly, it does not. The triangles must
    /// stay the same as long as the collider is matched from step to step, by its [`id`](Collider::id) or its order.
    ///
    /// The cloth is kept at the thickness of [`Options::contact`](crate::Options::contact), or that of
    /// [`Contact::default`](crate::Contact) if the cloth has no contact with itself. A mesh has no inside: it repels
    /// the cloth from both sides, so thin and open parts work as well, and edges are held as well as vertices. No
    /// triangle passes through (a thread, which has none, does), provided that nothing crosses where the mesh first appears
    /// ([`Warning::BodyCrossings`](crate::Warning::BodyCrossings)) and that pins and meshes move no faster than the
    /// substeps resolve ([`Warning::ContactOutruns`](crate::Warning::ContactOutruns)). Cloth whose edges are longer than about twice the
    /// thickness catches on sharp edges of a mesh even without friction, and stays on a bar if a quarter more of it hangs down on one side
    /// than on the other; give such a mesh rounder edges, or the cloth more vertices. With [`Backend::Gpu`](crate::Backend::Gpu)
    /// such a step waits for the GPU once; in a browser, which cannot wait, it returns an error.
    /// [`Backend::Auto`](crate::Backend::Auto) is decided before the first collider is known.
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
    /// all of its triangles; without any, the distance is infinite.
    ///
    /// # Panics
    /// If a triangle of a mesh names a vertex that it does not have.
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

    /// Two points (m) that move and turn with the collider.
    pub(crate) fn landmarks(&self) -> [Vec3; 2] {
        match &self.shape {
            &Shape::Sphere { center, radius } => [center, center + radius * Vec3::X],
            &Shape::Plane { point, normal } => [point, point + normal.normalize_or_zero()],
            &Shape::Capsule { a, b, .. } | &Shape::TaperedCapsule { a, b, .. } => [a, b],
            &Shape::RoundedBox { center, half, rotation, .. } => {
                [center, center + rotation.as_dquat().normalize().as_quat() * half]
            }
            Shape::Mesh { mesh } => [mesh.positions.first(), mesh.positions.last()].map(|x| x.copied().unwrap_or_default()),
        }
    }

    /// The same collider in coordinates relative to `origin`; a mesh is returned unchanged.
    pub(crate) fn relative_to(&self, origin: Vec3) -> Collider {
        let mut moved = self.clone();
        match &mut moved.shape {
            Shape::Sphere { center: point, .. } | Shape::Plane { point, .. } | Shape::RoundedBox { center: point, .. } => {
                *point -= origin;
            }
            Shape::Capsule { a, b, .. } | Shape::TaperedCapsule { a, b, .. } => (*a, *b) = (*a - origin, *b - origin),
            // A mesh has many vertices, so whoever reads them subtracts the origin.
            Shape::Mesh { .. } => {}
        }
        moved
    }
}

impl Shape {
    /// The mesh of a mesh collider.
    pub(crate) fn mesh(&self) -> Option<&Arc<Mesh>> {
        match self {
            Shape::Mesh { mesh } => Some(mesh),
            _ => None,
        }
    }

    /// The spheres at both ends of a round shape, by their centers and radii (m); those of a sphere are the same.
    pub(crate) fn ends(&self) -> Option<[(Vec3, f32); 2]> {
        match *self {
            Shape::Sphere { center, radius } => Some([(center, radius); 2]),
            Shape::Capsule { a, b, radius } => Some([(a, radius), (b, radius)]),
            Shape::TaperedCapsule { a, radius_a, b, radius_b } => Some([(a, radius_a), (b, radius_b)]),
            Shape::Plane { .. } | Shape::RoundedBox { .. } | Shape::Mesh { .. } => None,
        }
    }
}

recorded!(Collider { shape, friction, id, teleported });

impl Recorded for Shape {
    fn record(&mut self, tape: &mut Tape<'_>) -> Result<(), Unreadable> {
        let (zero, rotation, radius) = (Vec3::ZERO, Quat::IDENTITY, 0.0);
        // One of each kind. Their order is part of the format.
        let kinds = [
            Shape::Sphere { center: zero, radius },
            Shape::Plane { point: zero, normal: zero },
            Shape::Capsule { a: zero, b: zero, radius },
            Shape::TaperedCapsule { a: zero, radius_a: radius, b: zero, radius_b: radius },
            Shape::RoundedBox { center: zero, half: zero, rotation, radius },
            Shape::Mesh { mesh: Arc::default() },
        ];
        let mut kind = kinds.iter().take_while(|kind| discriminant(*kind) != discriminant(self)).count() as u8;
        kind.record(tape)?;
        if let Tape::In(_) = tape {
            *self = kinds.into_iter().nth(kind.into()).ok_or(Unreadable)?;
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
