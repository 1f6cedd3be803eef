//! Colliders of a scene file, which may move, and those of the command line.

use std::path::PathBuf;

use cloth_deformer::glam::{EulerRot, Quat, Vec3};
use cloth_deformer::{Collider, Mesh, Shape, UpAxis};
use toml::Spanned;

use super::bodies::Body;
use super::file::{self, File, ShapeName, Source};
use super::keys::Animated;
use super::timeline::{Moment, NO_PREROLL, Timeline};
use super::values::{Extent, Interpolated, NotNegative, Positive};
use crate::Failure;
use crate::arguments::Arguments;
use crate::pins::bounds;

/// Number of frames for which animated values are checked before the run.
const LOOKED_AHEAD: usize = 100_000;

/// Largest difference by rounding between quaternions, and between unit vectors, that are the same.
const SAME: f32 = 1e-5;

/// A collider that may move.
#[derive(Debug)]
pub(super) struct Moving {
    motion: Motion,
    friction: Option<f32>,
    id: Option<u64>,
}

/// The shape of a collider over time.
#[derive(Debug)]
enum Motion {
    Still(Collider),
    Sphere { center: Animated<Vec3>, radius: Animated<NotNegative> },
    Plane { point: Animated<Vec3>, normal: Animated<Vec3> },
    Capsule { a: Animated<Vec3>, b: Animated<Vec3>, radius: Animated<NotNegative> },
    TaperedCapsule { a: Animated<Vec3>, radius_a: Animated<Positive>, b: Animated<Vec3>, radius_b: Animated<Positive> },
    Box { center: Animated<Vec3>, half: Animated<Extent>, rotate: Animated<Vec3>, radius: Animated<NotNegative> },
    Mesh(Body),
}

/// The rotation by these angles (degrees) about x, then y, then z.
pub(super) fn turn(degrees: Vec3) -> Quat {
    let Vec3 { x, y, z } = degrees * (std::f32::consts::PI / 180.0);
    Quat::from_euler(EulerRot::ZYX, z, y, x)
}

/// Whether two rotations (degrees) lead to the same pose, as 0 and 360 do.
fn are_same_pose(first: Vec3, last: Vec3) -> bool {
    // The remainder is exact, while many turns in radians are not.
    let [first, last] = [first, last].map(|degrees| turn(degrees % 360.0));
    // Each pose has two quaternions.
    (first - last).length().min((first + last).length()) < SAME
}

/// Whether two normals point the same way: their lengths have no meaning.
fn are_same_direction(first: Vec3, last: Vec3) -> bool {
    first.normalize_or_zero().distance(last.normalize_or_zero()) < SAME
}

impl Moving {
    /// The collider at a moment, if the last frame was at the moment `last`.
    pub(super) fn at(&self, moment: Moment, last: Moment) -> Collider {
        let collider = match &self.motion {
            Motion::Still(collider) => collider.clone(),
            Motion::Sphere { center, radius } => Collider::sphere(center.at(moment), radius.at(moment).0),
            Motion::Plane { point, normal } => Collider::plane(point.at(moment), normal.at(moment)),
            Motion::Capsule { a, b, radius } => Collider::capsule(a.at(moment), b.at(moment), radius.at(moment).0),
            Motion::TaperedCapsule { a, radius_a, b, radius_b } => {
                Collider::tapered_capsule(a.at(moment), radius_a.at(moment).0, b.at(moment), radius_b.at(moment).0)
            }
            Motion::Box { center, half, rotate, radius } => {
                Collider::rounded_box(center.at(moment), half.at(moment).0, turn(rotate.at(moment)), radius.at(moment).0)
            }
            Motion::Mesh(body) => Collider::mesh(body.at(moment)),
        };
        let collider = if self.jumps(last.time, moment.time) { collider.teleported() } else { collider };
        let friction = self.friction.unwrap_or(collider.friction);
        Collider { id: self.id, ..collider.with_friction(friction) }
    }

    /// Whether a loop whose end differs from its start restarted between two times (s).
    fn jumps(&self, from: f64, to: f64) -> bool {
        match &self.motion {
            Motion::Still(_) | Motion::Mesh(_) => false,
            Motion::Sphere { center, radius } => center.jumps(from, to) || radius.jumps(from, to),
            Motion::Plane { point, normal } => point.jumps(from, to) || normal.jumps_unless(from, to, are_same_direction),
            Motion::Capsule { a, b, radius } => a.jumps(from, to) || b.jumps(from, to) || radius.jumps(from, to),
            Motion::TaperedCapsule { a, radius_a, b, radius_b } => {
                a.jumps(from, to) || b.jumps(from, to) || radius_a.jumps(from, to) || radius_b.jumps(from, to)
            }
            Motion::Box { center, half, rotate, radius } => {
                let turns_back = rotate.jumps_unless(from, to, are_same_pose);
                turns_back || center.jumps(from, to) || half.jumps(from, to) || radius.jumps(from, to)
            }
        }
    }

    /// Reads a collider of a scene file.
    fn read(
        arguments: &Arguments,
        source: &Source,
        name: &str,
        given: &Spanned<file::Collider>,
        timeline: Timeline,
        up: UpAxis,
    ) -> Result<Moving, Failure> {
        let file::Collider {
            name: _,
            shape,
            friction,
            id,
            center,
            radius,
            point,
            normal,
            a,
            b,
            radius_a,
            radius_b,
            half,
            rotate,
            mesh,
            start,
            scale,
        } = given.get_ref();
        let wrong = |what: String| source.wrong_in(given, format_args!("{name}: {what}"));
        let (called, known) = numbers_of(*shape);
        let given_numbers = [
            ("center", starts(center.as_ref())),
            ("radius", starts(radius.as_ref())),
            ("point", starts(point.as_ref())),
            ("normal", starts(normal.as_ref())),
            ("a", starts(a.as_ref())),
            ("b", starts(b.as_ref())),
            ("radius_a", starts(radius_a.as_ref())),
            ("radius_b", starts(radius_b.as_ref())),
            ("half", starts(half.as_ref())),
            ("rotate", starts(rotate.as_ref())),
            ("mesh", mesh.as_ref().map(|_| start.is_some())),
            ("start", start.as_ref().map(|_| true)),
            ("scale", scale.map(|_| false)),
        ];
        if let Some((other, _)) = given_numbers.into_iter().find(|&(number, given)| given.is_some() && !known.contains(&number)) {
            return Err(wrong(format!("{called} has no `{other}`; it has {}", known.join(", "))));
        }
        if timeline.preroll == 0 && given_numbers.into_iter().any(|(_, starts)| starts == Some(true)) {
            return Err(wrong(NO_PREROLL.to_owned()));
        }
        let missing = |number: &str| wrong(format!("{called} needs `{number}`"));
        let vector = |value: &Option<Animated<Vec3>>, number: &str| value.clone().ok_or_else(|| missing(number));
        let above_0 = || {
            let radius = radius.clone().ok_or_else(|| missing("radius"))?;
            if radius.values().all(|radius| radius.0 > 0.0) {
                Ok(radius)
            } else {
                Err(wrong("`radius` must be above 0".to_owned()))
            }
        };
        let tapered = |radius: &Option<Animated<Positive>>, number: &str| radius.clone().ok_or_else(|| missing(number));
        let motion = match shape {
            ShapeName::Sphere => Motion::Sphere { center: vector(center, "center")?, radius: above_0()? },
            ShapeName::Plane => Motion::Plane {
                point: vector(point, "point")?,
                normal: normal.clone().unwrap_or(Animated::still(up.turn(Vec3::Y))),
            },
            ShapeName::Capsule => Motion::Capsule { a: vector(a, "a")?, b: vector(b, "b")?, radius: above_0()? },
            ShapeName::TaperedCapsule => Motion::TaperedCapsule {
                a: vector(a, "a")?,
                radius_a: tapered(radius_a, "radius_a")?,
                b: vector(b, "b")?,
                radius_b: tapered(radius_b, "radius_b")?,
            },
            ShapeName::Box => Motion::Box {
                center: vector(center, "center")?,
                half: half.clone().ok_or_else(|| missing("half"))?,
                rotate: rotate.clone().unwrap_or(Animated::still(Vec3::ZERO)),
                radius: radius.clone().unwrap_or(Animated::still(NotNegative::ZERO)),
            },
            ShapeName::Mesh => {
                let path = source.beside(mesh.as_ref().ok_or_else(|| missing("mesh"))?.get_ref());
                let start = start.as_ref().map(|start| source.beside(start.get_ref()));
                let scale = arguments.scale.or(scale.map(|scale| scale.0));
                let body = Body::load(&path, start.as_deref(), scale, timeline.times());
                Motion::Mesh(body.map_err(|failure| wrong(format!("mesh: {}", failure.message)))?)
            }
        };
        let moving = Moving { motion, friction: friction.map(|friction| friction.0), id: *id };
        // Combinations that arise between keys are checked now, where the line is known, and not in the middle of a
        // run.
        for moment in timeline.preroll_moments().take(LOOKED_AHEAD).chain(timeline.moments().take(LOOKED_AHEAD)) {
            match moving.at(moment, moment).shape {
                Shape::Plane { normal, .. } if normal.as_dvec3().try_normalize().is_none() => {
                    return Err(wrong(format!(
                        "{moment} `normal` has no direction; give a vector out of the solid, other than 0"
                    )));
                }
                Shape::RoundedBox { half, radius, .. } if radius > half.min_element() => {
                    let remedy = "give a smaller radius, or a larger half";
                    return Err(wrong(format!(
                        "{moment} `radius` = {radius} m is more than the least of `half` = {half}; {remedy}"
                    )));
                }
                _ => {}
            }
        }
        Ok(moving)
    }

    /// The mesh collider, if it is one.
    pub(super) fn body(&self) -> Option<&Body> {
        if let Motion::Mesh(body) = &self.motion { Some(body) } else { None }
    }

    /// The files that it was read from.
    pub(super) fn files(&self) -> &[PathBuf] {
        self.body().map_or(&[], |body| &body.files)
    }

    /// A collider that does not move.
    fn still(collider: Collider) -> Moving {
        Moving { motion: Motion::Still(collider), friction: None, id: None }
    }
}

/// Whether a value has a start, if it is given.
fn starts<T: Interpolated>(value: Option<&Animated<T>>) -> Option<bool> {
    value.map(Animated::has_start)
}

/// The name of a shape, and the names of its values.
fn numbers_of(shape: ShapeName) -> (&'static str, &'static [&'static str]) {
    match shape {
        ShapeName::Sphere => ("a sphere", &["center", "radius"]),
        ShapeName::Plane => ("a plane", &["point", "normal"]),
        ShapeName::Capsule => ("a capsule", &["a", "b", "radius"]),
        ShapeName::TaperedCapsule => ("a tapered capsule", &["a", "radius_a", "b", "radius_b"]),
        ShapeName::Box => ("a box", &["center", "half", "rotate", "radius"]),
        ShapeName::Mesh => ("a mesh", &["mesh", "start", "scale"]),
    }
}

/// The option of the command line that replaces the scene's colliders of a shape, if any.
pub(crate) fn replacing(arguments: &Arguments, shape: ShapeName) -> Option<&'static str> {
    let Arguments { sphere, capsule, solid_box, body, plane, floor, no_sphere, no_floor, .. } = arguments;
    let options: &[(&str, bool)] = match shape {
        ShapeName::Sphere => &[("--sphere", !sphere.is_empty()), ("--no-sphere", *no_sphere)],
        ShapeName::Plane => &[("--plane", !plane.is_empty()), ("--floor", floor.is_some()), ("--no-floor", *no_floor)],
        ShapeName::Capsule | ShapeName::TaperedCapsule => &[("--capsule", !capsule.is_empty())],
        ShapeName::Box => &[("--box", !solid_box.is_empty())],
        ShapeName::Mesh => &[("--body", !body.is_empty())],
    };
    options.iter().find(|&&(_, is_given)| is_given).map(|&(option, _)| option)
}

/// All colliders of a run, each after the place where it was given. Those of a shape on the command line replace those of the same
/// shape in the scene file.
pub(super) fn colliders(
    arguments: &Arguments,
    scene: Option<(&Source, &File)>,
    mesh: &Mesh,
    timeline: Timeline,
    up: UpAxis,
) -> Result<Vec<(String, Moving)>, Failure> {
    let Arguments { sphere, capsule, solid_box, body, plane, floor, no_sphere, no_floor, .. } = arguments;
    let still = |option: &str, collider: &Collider| (option.to_owned(), Moving::still(collider.clone()));
    let (mut all, mut under) = (Vec::new(), None);
    if let Some((source, file)) = scene {
        for (number, given) in file.collider.iter().enumerate() {
            if let Some(id) = given.get_ref().id
                && let Some(earlier) = file.collider[..number].iter().find(|earlier| earlier.get_ref().id == Some(id))
            {
                let other = earlier.get_ref().name.as_deref().unwrap_or("another collider");
                return Err(source.wrong_in(given, format_args!("id = {id} is that of {other}; give each its own")));
            }
            // What is replaced is not read: its files may not be there.
            if replacing(arguments, given.get_ref().shape).is_none() {
                let name = given.get_ref().name.clone().unwrap_or_else(|| format!("collider {}", number + 1));
                let place = format!("{}: {name}", source.place(given.span().start));
                all.push((place, Moving::read(arguments, source, &name, given, timeline, up)?));
            }
        }
    } else {
        let [ball, ground] = usual(arguments, mesh, up);
        let is_bare = sphere.is_empty() && capsule.is_empty() && solid_box.is_empty() && body.is_empty();
        all.extend((is_bare && !no_sphere).then(|| still("the default sphere", &ball)));
        under = (plane.is_empty() && floor.is_none() && !no_floor).then(|| still("the default floor", &ground));
    }
    let floor = floor.map(|height| ground_at(height, up));
    for (option, solids) in [("--sphere", sphere), ("--capsule", capsule), ("--box", solid_box)] {
        all.extend(solids.iter().map(|solid| still(option, solid)));
    }
    for path in body {
        let body = Body::load(path, None, arguments.scale, timeline.times())?;
        all.push((format!("--body {}", path.display()), Moving { motion: Motion::Mesh(body), friction: None, id: None }));
    }
    all.extend(under);
    all.extend(floor.iter().map(|floor| still("--floor", floor)).chain(plane.iter().map(|plane| still("--plane", plane))));
    for (_, moving) in &mut all {
        moving.friction = arguments.friction.or(moving.friction);
    }
    Ok(all)
}

/// The default sphere and floor of a run without a scene, in proportion to the mesh: for a largest extent of 1 m, and
/// for the towel, a sphere with a radius of 0.3 m whose top is 0.1 m below the mesh, and the floor that it rests on.
fn usual(arguments: &Arguments, mesh: &Mesh, up: UpAxis) -> [Collider; 2] {
    let (low, high) = bounds(mesh);
    let extent = (high - low).max_element();
    // A mesh of a single point has no size to go by.
    let size = if extent > 0.0 && arguments.mesh.is_some() { extent } else { arguments.scale.unwrap_or(1.0) };
    let (above, middle) = (up.turn(Vec3::Y), 0.5 * (low + high));
    let ground = low.dot(above) - 0.7 * size;
    let center = middle - above * middle.dot(above) + above * (ground + 0.3 * size);
    [Collider::sphere(center, 0.3 * size), ground_at(ground, up)]
}

fn ground_at(height: f32, up: UpAxis) -> Collider {
    Collider::plane(up.turn(Vec3::Y * height), up.turn(Vec3::Y))
}
