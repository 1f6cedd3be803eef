//! The scene file: what may stand in it, and in which units. Anything else is refused with its line.
//!
//! Lengths are meters, masses kilograms, times seconds, angles degrees; y is up. Files that are read are named from the scene file's folder,
//! files that are written from the folder that the program runs in, as on the command line. A value that may have key frames is
//! [`Animated`].

use std::fmt::Display;
use std::io::Read;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::{fmt, fs};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Backend, Fabric, Levels, Method, Tethers};
use serde::Deserialize;
use serde::de::{Deserializer, Error, MapAccess, Visitor, value::MapAccessDeserializer};
use toml::Spanned;

use super::keys::{Animated, Extent, NotNegative, Positive, maybe, plain};
use crate::Failure;
use crate::arguments::{BACKENDS, FORMATS, Format, LEVELS, METHODS};

/// Bytes of a scene file, at most.
const MOST_BYTES: u64 = 1 << 24;

/// A scene.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct File {
    /// Number of frames, the first being the cloth at rest. 120.
    pub(crate) frames: Option<NonZeroU32>,
    /// Frames a second. 60.
    pub(crate) fps: Option<Spanned<Positive>>,
    /// Where the work is done: "auto", "cpu", "hybrid" or "gpu". "auto".
    #[serde(deserialize_with = "backend")]
    pub(crate) backend: Option<Backend>,
    pub(crate) quality: Option<Spanned<Quality>>,
    /// Contact of the cloth with itself; none if it is not there.
    pub(crate) contact: Option<Spanned<Contact>>,
    /// Gravity (m/s²). [0, -9.81, 0].
    pub(crate) gravity: Option<Animated<Vec3>>,
    /// The air; none if it is not there.
    pub(crate) wind: Option<Spanned<Wind>>,
    /// The cloths, which are pieces of one mesh in this order. One at least.
    pub(crate) cloth: Vec<Spanned<Cloth>>,
    /// What they meet.
    pub(crate) collider: Vec<Spanned<Collider>>,
    pub(crate) output: Output,
    /// What is varied from run to run of a sweep; every value with every other. A run without `--variant` knows nothing of it.
    pub(crate) vary: Vec<Spanned<Vary>>,
}

/// Values that a key of the scene has in turn: `values`, or the whole numbers from `first` on, `count` of them.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Vary {
    /// The key's path: `wind.gusts.seed`; in lists by name or by number from 1, `collider.ball.radius`, `cloth.1.fabric`.
    pub(crate) key: String,
    /// Anything that the key may be.
    #[serde(default)]
    pub(crate) values: Vec<toml::Value>,
    /// 1.
    pub(crate) first: Option<i64>,
    pub(crate) count: Option<NonZeroU32>,
}

/// How finely a frame is divided: one of `substeps`, `strain` and `budget`, else a strain of 0.03.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Quality {
    /// Substeps in 1/60 s.
    pub(crate) substeps: Option<NonZeroU32>,
    /// Stretch beyond the fabric's own that a share of the area is held to; 0.03 is three per cent.
    pub(crate) strain: Option<Positive>,
    /// That share, from 0.5 to 1. 0.99.
    pub(crate) share: Option<Positive>,
    /// Time (ms) that a frame may take; no two runs are the same by it.
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
    /// Sweeps in a substep of relaxation. 20.
    pub(crate) iterations: Option<NonZeroU32>,
}

/// Contact of the cloth with itself and with the other cloths.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Contact {
    /// How far apart it is held (m). 0.005.
    pub(crate) thickness: Option<Positive>,
    /// Coulomb's coefficient of friction. 0.3.
    pub(crate) friction: Option<NotNegative>,
    /// Whether a start that crosses itself or a body is parted before the first frame. False.
    pub(crate) untangle: bool,
}

/// The air, and how it moves.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Wind {
    /// Its velocity (m/s), before gusts.
    pub(crate) velocity: Animated<Vec3>,
    /// Its density (kg/m³). 1.225.
    pub(crate) density: Option<NotNegative>,
    /// Drag coefficient of cloth across the stream. 1.28.
    pub(crate) drag: Option<NotNegative>,
    /// Lift coefficient, at most `drag`. As `drag`.
    pub(crate) lift: Option<NotNegative>,
    /// Rate (1/s) at which each vertex's velocity tends to the air's, beside the forces. 0.
    pub(crate) damping: Option<NotNegative>,
    pub(crate) gusts: Option<Gusts>,
}

/// Gusts: the velocity swells, and turns about the vertical, by smooth noise.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Gusts {
    /// By which share of itself the velocity swells and falls at most.
    pub(crate) strength: NotNegative,
    /// How far to either side it turns at most (degrees). 0.
    pub(crate) turn: Option<NotNegative>,
    /// Time (s) from one gust to the next. 1.
    pub(crate) period: Option<Positive>,
    /// Which gusts. 0.
    #[serde(default)]
    pub(crate) seed: u32,
}

/// A cloth: from an OBJ file or a grid, then scaled, turned and moved.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Cloth {
    /// What errors call it. Its number.
    pub(crate) name: Option<String>,
    /// An OBJ file.
    pub(crate) mesh: Option<Spanned<PathBuf>>,
    /// A flat sheet in the plane y = 0, about the origin.
    pub(crate) grid: Option<Spanned<Grid>>,
    /// What its coordinates are multiplied by. 1.
    pub(crate) scale: Option<Positive>,
    /// How it is turned (degrees): about x, then y, then z.
    #[serde(deserialize_with = "maybe")]
    pub(crate) rotate: Option<Vec3>,
    /// Where its origin is then (m).
    #[serde(deserialize_with = "maybe")]
    pub(crate) at: Option<Vec3>,
    /// A name ("towel", "cotton", "silk", "denim", "jersey"), or a table of numbers. "towel". All cloths of a scene are of one fabric.
    #[serde(deserialize_with = "fabric")]
    pub(crate) fabric: Option<Fabric>,
    /// What holds it.
    pub(crate) pin: Vec<Spanned<Pin>>,
}

/// A flat sheet.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Grid {
    /// Vertices along x and along z.
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// Length along x and along z (m).
    pub(crate) width: Positive,
    pub(crate) height: Positive,
}

/// The numbers of a fabric.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct FabricNumbers {
    /// Where numbers that are not given come from. "towel".
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

/// A group of pinned vertices of a cloth, chosen by one of `rule`, `vertices`, `color` and `box`; and how it is led.
///
/// At a time its vertices are where they were at frame 1, scaled by `scale` and turned by `rotate` about `about`, and moved by `move`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Pin {
    /// What errors call it. Its number.
    pub(crate) name: Option<String>,
    /// "top": the highest vertices, or the side of lowest z of a cloth that lies flat; "corners": the nearest to its corners.
    pub(crate) rule: Option<Rule>,
    /// Numbers of vertices from 0, in the order of the cloth's own file.
    pub(crate) vertices: Option<Vec<u32>>,
    /// All vertices that have this color (red, green, blue from 0 to 1) in the OBJ file, `v x y z r g b`.
    #[serde(deserialize_with = "maybe")]
    pub(crate) color: Option<Vec3>,
    /// All vertices in a box, where they are at frame 1.
    #[serde(rename = "box")]
    pub(crate) within: Option<Bounds>,
    /// By how much it is moved (m).
    #[serde(rename = "move")]
    pub(crate) by: Option<Animated<Vec3>>,
    /// How it is turned (degrees): about x, then y, then z.
    pub(crate) rotate: Option<Animated<Vec3>>,
    /// How it is stretched along x, y and z. A curtain's rings are drawn together by it.
    pub(crate) scale: Option<Animated<Extent>>,
    /// A point that neither turning nor stretching moves (m). The middle of its vertices' bounds.
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

/// A box along the axes.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Bounds {
    /// Its corners of lowest and highest coordinates (m).
    #[serde(deserialize_with = "plain")]
    pub(crate) low: Vec3,
    #[serde(deserialize_with = "plain")]
    pub(crate) high: Vec3,
}

/// What cloth meets. Each shape has numbers of its own, all of which may have key frames.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Collider {
    /// What errors call it. Its number.
    pub(crate) name: Option<String>,
    pub(crate) shape: ShapeName,
    /// Coulomb's coefficient of friction. 0.3.
    pub(crate) friction: Option<NotNegative>,
    /// A number of its own; nobody needs one as long as the list of colliders stays the same.
    pub(crate) id: Option<u64>,
    /// Of a sphere or a box (m).
    pub(crate) center: Option<Animated<Vec3>>,
    /// Of a sphere or a capsule (m); of a box's edges, 0 if it is not there.
    pub(crate) radius: Option<Animated<NotNegative>>,
    /// A point of a plane (m).
    pub(crate) point: Option<Animated<Vec3>>,
    /// Of a plane, out of the solid; any length but 0. [0, 1, 0].
    pub(crate) normal: Option<Animated<Vec3>>,
    /// The ends of a capsule's axis (m).
    pub(crate) a: Option<Animated<Vec3>>,
    pub(crate) b: Option<Animated<Vec3>>,
    /// Of a tapered capsule, at its ends (m).
    pub(crate) radius_a: Option<Animated<Positive>>,
    pub(crate) radius_b: Option<Animated<Positive>>,
    /// Half of a box's width, height and depth, rounded edges included (m).
    pub(crate) half: Option<Animated<Extent>>,
    /// How a box is turned (degrees): about x, then y, then z.
    pub(crate) rotate: Option<Animated<Vec3>>,
    /// A body's OBJ file; or with `####` in its name, numbered files, one for each frame from 1 on.
    pub(crate) mesh: Option<Spanned<PathBuf>>,
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

/// Files that are written.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Output {
    /// The folder of the frames. "frames".
    pub(crate) folder: Option<PathBuf>,
    /// What frames are written as, "obj", "pc2", "mdd" and "usda": a file each, or all in one in that folder. "obj" alone.
    pub(crate) format: Option<Vec<FormatName>>,
    /// All frames in one point cache.
    pub(crate) pc2: Option<PathBuf>,
    /// A contact sheet of twelve frames (PNG).
    pub(crate) preview: Option<PathBuf>,
    /// Figures of every frame (JSON).
    pub(crate) report: Option<PathBuf>,
}

impl Output {
    /// What frames are written as.
    pub(crate) fn formats(&self) -> Vec<Format> {
        self.format.as_ref().map_or_else(|| vec![Format::Obj], |names| names.iter().map(|name| name.0).collect())
    }
}

/// A format by its name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FormatName(Format);

impl<'de> Deserialize<'de> for FormatName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<FormatName, D::Error> {
        let format = named(deserializer, &FORMATS)?;
        format.map(FormatName).ok_or_else(|| D::Error::custom("it has no name"))
    }
}

/// A scene file's name and text, by which errors name a line.
#[derive(Debug)]
pub(crate) struct Source {
    path: PathBuf,
    text: String,
    /// What a variant of the scene is, whose text is not the file's: its lines are not named.
    variant: Option<String>,
}

impl Source {
    /// Reads a scene file.
    pub(crate) fn read(path: &Path) -> Result<(Source, File), Failure> {
        let wrong = |why: &dyn Display| Failure::input(format_args!("{}: {why}", path.display()));
        let mut text = String::new();
        let opened = fs::File::open(path).map_err(|error| wrong(&error))?;
        // What is no file may have no end.
        opened.take(MOST_BYTES + 1).read_to_string(&mut text).map_err(|error| wrong(&error))?;
        if text.len() as u64 > MOST_BYTES {
            return Err(wrong(&format_args!("it is longer than {MOST_BYTES} bytes, which no scene is")));
        }
        Source::parse(path, text, None)
    }

    /// Reads a scene file's text, or that of a variant.
    pub(crate) fn parse(path: &Path, text: String, variant: Option<String>) -> Result<(Source, File), Failure> {
        let source = Source { path: path.to_owned(), text, variant };
        let file = toml::from_str(&source.text);
        let file =
            file.map_err(|error: toml::de::Error| source.wrong(error.span().map_or(0, |span| span.start), error.message()))?;
        Ok((source, file))
    }

    /// What to call the scene.
    pub(crate) fn name(&self) -> String {
        self.path.display().to_string()
    }

    /// A file that is named in the scene.
    pub(crate) fn beside(&self, path: &Path) -> PathBuf {
        self.path.parent().map_or_else(|| path.to_owned(), |folder| folder.join(path))
    }

    /// Its text.
    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// What is wrong at some byte of the text.
    pub(crate) fn wrong(&self, at: usize, what: impl Display) -> Failure {
        if let Some(variant) = &self.variant {
            return Failure::input(format_args!("{}: {variant}: {what}", self.path.display()));
        }
        let line = 1 + self.text.bytes().take(at).filter(|&byte| byte == b'\n').count();
        Failure::input(format_args!("{}:{line}: {what}", self.path.display()))
    }

    /// What is wrong with a value or a table.
    pub(crate) fn wrong_in<T>(&self, place: &Spanned<T>, what: impl Display) -> Failure {
        self.wrong(place.span().start, what)
    }
}

/// One of a table's names, for its value.
fn named<'de, T: Copy, D: Deserializer<'de>>(deserializer: D, table: &[(&str, T)]) -> Result<Option<T>, D::Error> {
    let name = String::deserialize(deserializer)?;
    let names = || table.iter().map(|&(name, _)| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    let found = table.iter().find(|&&(known, _)| known == name);
    found.map(|&(_, value)| Some(value)).ok_or_else(|| D::Error::custom(format_args!("\"{name}\" is none of {}", names())))
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

/// A fabric's name, or a table of its numbers.
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
