//! The scene file: its keys and their units. Anything else is an error with its line.
//!
//! Lengths are in meters, masses in kilograms, times in seconds, angles in degrees; y is up, or z if gravity acts along z. Input
//! files are relative to the folder of the scene file, output files to the current folder, as on the command line. A value that
//! may have key frames, and a start before them, is [`Animated`]. Comments end with the default.

use std::fmt::Display;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::{fmt, fs};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Backend, Fabric, Levels, Method, Tethers};
use serde::Deserialize;
use serde::de::{Deserializer, Error, MapAccess, Visitor, value::MapAccessDeserializer};
use toml::Spanned;

use super::keys::Animated;
use super::values::{Color, Direction, Extent, NotNegative, Positive, Whole, list, maybe, maybe_list, plain, tables};
use crate::Failure;
use crate::arguments::{BACKENDS, FORMATS, Format, LEVELS, METHODS};

/// Largest size of a scene file (bytes).
const MAX_BYTES: u64 = 1 << 24;

/// A scene.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct File {
    /// Number of frames, including the first. 120.
    pub(crate) frames: Option<Whole<1>>,
    /// Time (s) simulated before frame 1, rounded to frames, none of which are written. In its first half, everything
    /// goes smoothly from its start to where it is at frame 1, pins from the mesh's own positions, colliders and the
    /// rest from their `start`; in its second half the cloth settles. 0, frame 1 is then the mesh.
    pub(crate) preroll: Option<Spanned<NotNegative>>,
    /// Frames per second. 60.
    pub(crate) fps: Option<Spanned<Positive>>,
    /// Processor that runs the simulation: "auto", "cpu", "hybrid" or "gpu". "auto".
    #[serde(deserialize_with = "backend")]
    pub(crate) backend: Option<Backend>,
    pub(crate) quality: Option<Spanned<Quality>>,
    /// Contact of the cloth with itself. None.
    pub(crate) contact: Option<Spanned<Contact>>,
    /// Gravity (m/s²). [0, -9.81, 0].
    pub(crate) gravity: Option<Spanned<Animated<Vec3>>>,
    /// The air. None.
    pub(crate) wind: Option<Spanned<Wind>>,
    /// The cloths, which become pieces of one mesh in this order. At least one.
    #[serde(deserialize_with = "tables")]
    pub(crate) cloth: Vec<Spanned<Cloth>>,
    /// What they meet.
    #[serde(deserialize_with = "tables")]
    pub(crate) collider: Vec<Spanned<Collider>>,
    pub(crate) picture: Picture,
    pub(crate) output: Output,
    /// Keys that vary between the runs of a sweep, in all combinations. Without `--variant` this is ignored, which a note tells.
    #[serde(deserialize_with = "tables")]
    pub(crate) vary: Vec<Spanned<Vary>>,
}

/// The values of a varied key: `values`, or `count` integers from `first` on.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a key and its values")]
pub(crate) struct Vary {
    /// The path of the key: `wind.gusts.seed`; in lists by name or by number from 1, `collider.ball.radius`,
    /// `cloth.1.fabric`.
    pub(crate) key: String,
    /// Any values that are valid for the key.
    #[serde(default, deserialize_with = "list")]
    pub(crate) values: Vec<Spanned<toml::Value>>,
    /// 1.
    pub(crate) first: Option<i64>,
    pub(crate) count: Option<Whole<1>>,
}

/// The number of substeps: one of `substeps`, `strain` and `budget`; by default a strain of 0.03.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table of substeps, strain or budget")]
pub(crate) struct Quality {
    /// Substeps per 1/60 s.
    pub(crate) substeps: Option<Whole<1>>,
    /// Bound on the stretch of a share of the area beyond the fabric's own; 0.03 is three percent.
    pub(crate) strain: Option<Positive>,
    /// That share, from 0.5 to 1. 0.99.
    pub(crate) share: Option<Positive>,
    /// Time (ms) that a frame may take. Runs are then not repeatable.
    pub(crate) budget: Option<Positive>,
    /// "auto" or "off". "auto".
    #[serde(deserialize_with = "levels")]
    pub(crate) levels: Option<Levels>,
    /// "auto" or "off". "auto".
    #[serde(deserialize_with = "tethers")]
    pub(crate) tethers: Option<Tethers>,
    /// "small-steps", "relaxation" or "springs". "small-steps".
    #[serde(deserialize_with = "method")]
    pub(crate) method: Option<Method>,
    /// Sweeps per substep of relaxation. 20.
    pub(crate) iterations: Option<Whole<1>>,
}

/// Contact of the cloth with itself and with the other cloths.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table of thickness, friction and untangle")]
pub(crate) struct Contact {
    /// Thickness (m). 0.005.
    pub(crate) thickness: Option<Positive>,
    /// Coefficient of Coulomb friction. 0.3.
    pub(crate) friction: Option<NotNegative>,
    /// Whether cloth that crosses itself or a mesh collider is separated, before the first frame and every 0.2 s later. False.
    pub(crate) untangle: bool,
}

/// The air and its motion.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of velocity and gusts")]
pub(crate) struct Wind {
    /// Its velocity (m/s) without gusts.
    pub(crate) velocity: Animated<Vec3>,
    /// Its density (kg/m³). 1.225.
    pub(crate) density: Option<NotNegative>,
    /// Drag coefficient of cloth perpendicular to the flow. 1.28.
    pub(crate) drag: Option<NotNegative>,
    /// Lift coefficient, at most `drag`. The value of `drag`.
    pub(crate) lift: Option<NotNegative>,
    /// Rate (1/s) at which each vertex's velocity approaches that of the air, in addition to drag and lift. 0.
    pub(crate) damping: Option<NotNegative>,
    pub(crate) gusts: Option<Gusts>,
}

/// Gusts: the speed varies and the direction turns about the vertical, by smooth noise.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of strength, turn and period")]
pub(crate) struct Gusts {
    /// Largest relative change of the speed.
    pub(crate) strength: NotNegative,
    /// Largest angle of the direction to either side (degrees). 0.
    pub(crate) turn: Option<NotNegative>,
    /// Time between gusts (s). 1.
    pub(crate) period: Option<Positive>,
    /// Seed of the random numbers. 0.
    #[serde(default)]
    pub(crate) seed: u32,
}

/// A cloth: from an OBJ file or a grid, then scaled, rotated and moved.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table of a cloth")]
pub(crate) struct Cloth {
    /// Name in error messages. Its number.
    pub(crate) name: Option<String>,
    /// An OBJ file.
    pub(crate) mesh: Option<Spanned<PathBuf>>,
    /// A flat sheet in the horizontal plane through the origin, centered on it.
    pub(crate) grid: Option<Spanned<Grid>>,
    /// Factor on its coordinates. 1.
    pub(crate) scale: Option<Positive>,
    /// Rotation (degrees) about x, then y, then z.
    #[serde(deserialize_with = "maybe")]
    pub(crate) rotate: Option<Vec3>,
    /// Translation (m) after that.
    #[serde(deserialize_with = "maybe")]
    pub(crate) at: Option<Vec3>,
    /// A name ("towel", "cotton", "silk", "denim", "jersey") or a table of values. "towel". Cloths of a scene may
    /// differ in all but the damping.
    #[serde(deserialize_with = "fabric")]
    pub(crate) fabric: Option<Fabric>,
    /// Shear stiffness (N/m), 20 to 100 for woven cloth, of a grid or of an OBJ with polygons of four corners; the other
    /// polygons are as stiff in shear as in stretch. As stiff as the edges make it: a quarter of the fabric's `stretch`.
    pub(crate) shear: Option<NotNegative>,
    /// Its pins.
    #[serde(deserialize_with = "tables")]
    pub(crate) pin: Vec<Spanned<Pin>>,
    /// Color in pictures (sRGB: red, green and blue from 0 to 1) of the side from which its triangles are
    /// counterclockwise. Red.
    #[serde(deserialize_with = "maybe")]
    pub(crate) color: Option<Color>,
    /// Color of the other side. Tan.
    #[serde(deserialize_with = "maybe")]
    pub(crate) lining: Option<Color>,
}

/// A flat sheet.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of columns, rows, width and height")]
pub(crate) struct Grid {
    /// Vertices along x and along z, or along y if z is up.
    pub(crate) columns: Whole<0>,
    pub(crate) rows: Whole<0>,
    /// Length along x and along z, or along y if z is up (m).
    pub(crate) width: Positive,
    pub(crate) height: Positive,
}

/// The values of a fabric.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FabricNumbers {
    /// The preset that other values are taken from. "towel".
    #[serde(default, deserialize_with = "preset")]
    preset: Option<Fabric>,
    /// Areal density (kg/m²).
    density: Option<Positive>,
    /// Membrane stiffness (N/m).
    stretch: Option<Positive>,
    /// Bending rigidity (N m).
    bending: Option<NotNegative>,
    /// Retardation time of bending (s).
    damping: Option<NotNegative>,
}

/// A group of pinned vertices of a cloth, chosen by one of `rule`, `vertices`, `color` and `box`, and its motion.
///
/// At any time its vertices are at their positions in the mesh, scaled by `scale` and rotated by `rotate` about `about`,
/// and moved by `move`. Without a preroll, the run begins without a motion; a preroll begins so.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table of which vertices are pinned, and how they move")]
pub(crate) struct Pin {
    /// Name in error messages. Its number.
    pub(crate) name: Option<String>,
    /// "top": the highest vertices, or the far side of a horizontal cloth, of lowest z, or of highest y if z is up; "corners": the four nearest to its
    /// corners.
    pub(crate) rule: Option<Rule>,
    /// Vertex numbers from 0, in the order of the cloth's own file.
    #[serde(deserialize_with = "maybe_list")]
    pub(crate) vertices: Option<Vec<Whole<0>>>,
    /// All vertices with this color (red, green, blue from 0 to 1) in the OBJ file, `v x y z r g b`.
    #[serde(deserialize_with = "maybe")]
    pub(crate) color: Option<Vec3>,
    /// All vertices whose positions in the mesh are in a box.
    #[serde(rename = "box")]
    pub(crate) within: Option<Bounds>,
    /// Translation (m).
    #[serde(rename = "move")]
    pub(crate) by: Option<Animated<Vec3>>,
    /// Rotation (degrees) about x, then y, then z.
    pub(crate) rotate: Option<Animated<Vec3>>,
    /// Factors along x, y and z. They can, for example, draw the rings of a curtain together.
    pub(crate) scale: Option<Animated<Extent>>,
    /// Center of rotation and scaling (m). The center of the group's bounding box.
    #[serde(deserialize_with = "maybe")]
    pub(crate) about: Option<Vec3>,
}

/// Rules that choose vertices.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Rule {
    Top,
    Corners,
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of low and high")]
pub(crate) struct Bounds {
    /// Its lowest and highest corner (m).
    #[serde(deserialize_with = "plain")]
    pub(crate) low: Vec3,
    #[serde(deserialize_with = "plain")]
    pub(crate) high: Vec3,
}

/// A collider. Each shape has values of its own, all of which may be animated.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a shape and how it moves")]
pub(crate) struct Collider {
    /// Name in error messages. Its number.
    pub(crate) name: Option<String>,
    pub(crate) shape: ShapeName,
    /// Coefficient of Coulomb friction. 0.3.
    pub(crate) friction: Option<NotNegative>,
    /// A unique number, needed only if the list of colliders changes: see `Collider::with_id`.
    pub(crate) id: Option<u64>,
    /// Center of a sphere or a box (m).
    pub(crate) center: Option<Animated<Vec3>>,
    /// Radius of a sphere or a capsule (m); of a box's edges, by default 0.
    pub(crate) radius: Option<Animated<NotNegative>>,
    /// A point on a plane (m).
    pub(crate) point: Option<Animated<Vec3>>,
    /// Normal of a plane, pointing out of the solid; any length but 0. Up: [0, 1, 0], or [0, 0, 1] if z is
    /// up.
    pub(crate) normal: Option<Animated<Vec3>>,
    /// The ends of a capsule's axis (m).
    pub(crate) a: Option<Animated<Vec3>>,
    pub(crate) b: Option<Animated<Vec3>>,
    /// Radii of a tapered capsule at its ends (m).
    pub(crate) radius_a: Option<Animated<Positive>>,
    pub(crate) radius_b: Option<Animated<Positive>>,
    /// Half of a box's width, height and depth, including rounded edges (m).
    pub(crate) half: Option<Animated<Extent>>,
    /// Rotation of a box (degrees) about x, then y, then z.
    pub(crate) rotate: Option<Animated<Vec3>>,
    /// The OBJ file of a mesh collider; with `####` in its name, unless that is the name of a file, numbered files, one for each
    /// frame from 1 on.
    pub(crate) mesh: Option<Spanned<PathBuf>>,
    /// The OBJ file of a mesh collider at the start of the preroll. Its shape at frame 1.
    pub(crate) start: Option<Spanned<PathBuf>>,
    /// Factor on the coordinates of a mesh collider. 1.
    pub(crate) scale: Option<Positive>,
}

/// Shapes of colliders.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ShapeName {
    Sphere,
    Plane,
    Capsule,
    TaperedCapsule,
    Box,
    Mesh,
}

/// Settings of the preview and the animation.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table of from and begin")]
pub(crate) struct Picture {
    /// The direction from the scene toward the camera; any length but 0. [0.52, 0.5, 1], or
    /// [0.52, -1, 0.5] if z is up.
    #[serde(deserialize_with = "maybe")]
    pub(crate) from: Option<Direction>,
    /// The time (s) of the first frame in the animation. 0.
    pub(crate) begin: Option<NotNegative>,
}

/// The files to write.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table of a folder and a format")]
pub(crate) struct Output {
    /// The folder for the frames. "frames".
    pub(crate) folder: Option<PathBuf>,
    /// Formats of the frames, "obj", "pc2", "mdd" and "usda": one file per frame, or all frames in one file in that
    /// folder. "obj".
    #[serde(deserialize_with = "formats")]
    pub(crate) format: Option<Vec<Format>>,
    /// A PC2 point cache of all frames.
    pub(crate) pc2: Option<PathBuf>,
    /// A contact sheet of twelve frames (PNG).
    pub(crate) preview: Option<PathBuf>,
    /// An animation of the run (animated PNG).
    pub(crate) animation: Option<PathBuf>,
    /// Measurements and warnings of every frame (JSON).
    pub(crate) report: Option<PathBuf>,
}

impl Output {
    /// The formats of the frames.
    pub(crate) fn formats(&self) -> Vec<Format> {
        self.format.clone().unwrap_or_else(|| vec![Format::Obj])
    }
}

impl<'de> Deserialize<'de> for Format {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Format, D::Error> {
        named(deserializer, &FORMATS)?.ok_or_else(|| D::Error::custom("it has no name"))
    }
}

/// Path and text of a scene file, by which errors find a line.
#[derive(Debug)]
pub(crate) struct Source {
    path: PathBuf,
    text: String,
    /// The values of a variant. Its text is not that of the file, so errors name no line.
    variant: Option<String>,
}

impl Source {
    /// Reads a scene file.
    pub(crate) fn read(path: &Path) -> Result<(Source, File), Failure> {
        let wrong = |why: &dyn Display| Failure::input(format_args!("{}: {why}", path.display()));
        let unread = |error| wrong(&format_args!("cannot be read: {error}; check the path"));
        let mut text = String::new();
        let opened = fs::File::open(path).map_err(unread)?;
        // A path that is not a regular file may be endless.
        opened.take(MAX_BYTES + 1).read_to_string(&mut text).map_err(unread)?;
        if text.len() as u64 > MAX_BYTES {
            return Err(wrong(&format_args!("it is longer than {MAX_BYTES} bytes, which no scene is")));
        }
        Source::parse(path, text, None)
    }

    /// Parses the text of a scene file or of a variant.
    pub(crate) fn parse(path: &Path, text: String, variant: Option<String>) -> Result<(Source, File), Failure> {
        let source = Source { path: path.to_owned(), text, variant };
        let file = toml::from_str(&source.text)
            .map_err(|error: toml::de::Error| source.wrong(error.span().map_or(0, |span| span.start), said(error)))?;
        Ok((source, file))
    }

    /// Name of the scene in messages.
    pub(crate) fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// The path of a file named in the scene.
    pub(crate) fn beside(&self, path: &Path) -> PathBuf {
        self.path.parent().map_or_else(|| path.to_owned(), |folder| folder.join(path))
    }

    /// The text.
    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// The error for a byte of the text.
    pub(crate) fn wrong(&self, at: usize, what: impl Display) -> Failure {
        Failure::input(format_args!("{}: {what}", self.place(at)))
    }

    /// The file and the line of a byte of the text.
    pub(super) fn place(&self, at: usize) -> String {
        if let Some(variant) = &self.variant {
            return format!("{}: {variant}", self.path.display());
        }
        let line = 1 + self.text.bytes().take(at).filter(|&byte| byte == b'\n').count();
        format!("{}:{line}", self.path.display())
    }

    /// The error for a value or a table.
    pub(crate) fn wrong_in<T>(&self, place: &Spanned<T>, what: impl Display) -> Failure {
        self.wrong(place.span().start, what)
    }
}

/// What an error says, after the key that it is about, if any.
pub(crate) fn said(mut error: toml::de::Error) -> String {
    // Without the text, the error ends with its keys, which it has no other way to tell.
    error.set_input(None);
    let text = error.to_string();
    match text.trim_end().trim_end_matches('`').rsplit_once("\nin `") {
        Some((what, key)) => format!("{key}: {what}"),
        None => error.message().to_owned(),
    }
}

/// Parses one of the names of a table into its value.
fn named<'de, T: Copy, D: Deserializer<'de>>(deserializer: D, table: &[(&str, T)]) -> Result<Option<T>, D::Error> {
    let name = String::deserialize(deserializer)?;
    let names = || table.iter().map(|&(name, _)| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    let found = table.iter().find(|&&(known, _)| known == name);
    found.map(|&(_, value)| Some(value)).ok_or_else(|| D::Error::custom(format_args!("\"{name}\" is none of {}", names())))
}

/// Parses the formats of the frames: without any, nothing would be written.
fn formats<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<Format>>, D::Error> {
    match maybe_list(deserializer)? {
        Some(names) if names.is_empty() => Err(D::Error::custom("there is no format; name one, or leave it out for \"obj\"")),
        names => Ok(names),
    }
}

fn backend<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Backend>, D::Error> {
    named(deserializer, &BACKENDS)
}

fn method<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Method>, D::Error> {
    named(deserializer, &METHODS)
}

fn levels<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Levels>, D::Error> {
    named(deserializer, &LEVELS)
}

fn tethers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Tethers>, D::Error> {
    named(deserializer, &[("auto", Tethers::Auto), ("off", Tethers::Off)])
}

fn preset<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Fabric>, D::Error> {
    named(deserializer, Fabric::PRESETS)
}

/// Parses a fabric's name or a table of its values.
fn fabric<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Fabric>, D::Error> {
    struct NameOrNumbers;

    impl<'de> Visitor<'de> for NameOrNumbers {
        type Value = Option<Fabric>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a fabric's name or a table of its numbers")
        }

        fn visit_str<E: Error>(self, name: &str) -> Result<Option<Fabric>, E> {
            preset(serde::de::value::StrDeserializer::new(name))
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Option<Fabric>, A::Error> {
            let numbers = FabricNumbers::deserialize(MapAccessDeserializer::new(map))?;
            let base = numbers.preset.unwrap_or(Fabric::TOWEL);
            Ok(Some(Fabric {
                density: numbers.density.map_or(base.density, |size| size.0),
                stretch: numbers.stretch.map_or(base.stretch, |size| size.0),
                bending: numbers.bending.map_or(base.bending, |size| size.0),
                damping: numbers.damping.map_or(base.damping, |size| size.0),
            }))
        }
    }
    deserializer.deserialize_any(NameOrNumbers)
}
