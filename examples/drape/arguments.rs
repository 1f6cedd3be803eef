//! The command line.

use std::{ops::RangeInclusive, path::PathBuf};

use clap::{Parser, Subcommand, value_parser};
use cloth_deformer::{
    Backend, Collider, Fabric, Levels, Method, Tolerance,
    glam::{Quat, Vec3},
};

use crate::{command::one_of, pins::Pin, tuned::tolerance};

/// Names of the backends.
pub(crate) const BACKENDS: [(&str, Backend); 4] =
    [("auto", Backend::Auto), ("cpu", Backend::Cpu), ("hybrid", Backend::Hybrid), ("gpu", Backend::Gpu)];

/// Names of the methods.
pub(crate) const METHODS: [(&str, Method); 3] =
    [("small-steps", Method::SmallSteps), ("relaxation", Method::Relaxation { iterations: 20 }), ("springs", Method::Springs)];
/// Names of the levels.
pub(crate) const LEVELS: [(&str, Levels); 2] = [("auto", Levels::Auto), ("off", Levels::Off)];

/// The file formats of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    Obj,
    Pc2,
    Mdd,
    Usda,
}

/// Names of the formats.
pub(crate) const FORMATS: [(&str, Format); 4] =
    [("obj", Format::Obj), ("pc2", Format::Pc2), ("mdd", Format::Mdd), ("usda", Format::Usda)];

/// Simulates cloth that falls, hangs or moves in a scene, and writes every frame as an OBJ file.
///
/// Lengths are in meters, masses in kilograms, y is up, or z if gravity acts along z. Without a mesh or a scene, a towel of
/// 1.2 m x 1.2 m with 64 x 64 vertices falls from 0.7 m.
#[derive(Debug, Clone, Parser)]
#[command(
    name = "drape",
    version,
    args_conflicts_with_subcommands = true,
    disable_help_subcommand = true,
    after_help = "\
Frame 1 is the input mesh, unless there is a preroll; each further frame is one step of 1/FPS seconds. OBJ frames keep the order of vertices and faces and
everything else in the input file: polygons, texture coordinates, groups, materials; normals turn with the cloth. If --out contains
frames of a longer run, the program ends with an error instead of mixing them with new ones.
Exit codes: 0 done, 1 different (diff), 2 bad input, 3 unstable, 4 GPU not available or failed, 130 interrupted. Files are written
completely or not at all."
)]
#[expect(clippy::struct_excessive_bools, reason = "each is a separate flag")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) task: Option<Task>,

    /// The cloth: triangles or polygons. Default: the towel
    #[arg(value_name = "MESH.obj")]
    pub(crate) mesh: Option<PathBuf>,

    /// A scene: cloths, pins, colliders, wind, and how they move; options on the command line override it. See
    /// examples/scenes
    #[arg(long, value_name = "FILE.toml")]
    pub(crate) scene: Option<PathBuf>,

    /// Only check the values of the scene's [[vary]] and print the number of variants that they define
    #[arg(long, requires = "scene", conflicts_with = "variant")]
    pub(crate) list: bool,

    /// Run one or several variants of the scene, counted from 1. Each gets a folder in --out, `variant_0001` and so on,
    /// with a receipt. A folder appears only when it is complete, and is then not run again unless its receipt has other
    /// inputs, such as another scene; then it is replaced
    #[arg(long, value_name = "I|I-J", requires = "scene", conflicts_with_all = ["save", "resume"], value_parser = variants, allow_hyphen_values = true)]
    pub(crate) variant: Option<RangeInclusive<u32>>,

    /// Write no frames: find the cheapest settings that keep this error, a distance from a resolved run (10mm) or a
    /// stretch of 99 % of the area (3%), and the error without each term of the scene. It takes about three times as long
    /// as the resolved run
    #[arg(long, value_name = "ERROR", value_parser = tolerance, allow_hyphen_values = true,
          conflicts_with_all = ["list", "variant", "save", "resume", "untangle", "preview", "animate", "report", "pc2"])]
    pub(crate) tune: Option<Tolerance>,

    /// Factor on the coordinates of all meshes, of colliders, too: 0.01 if they are in centimeters; frames are written in
    /// meters, not in the units of the mesh [default: 1]
    #[arg(long, value_name = "S", value_parser = positive, allow_hyphen_values = true)]
    pub(crate) scale: Option<f32>,

    /// Folder for the frames, `frame_0001.obj` and so on; created if it does not exist [default: frames]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// Number of frames, including the first [default: 120]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), allow_hyphen_values = true)]
    pub(crate) frames: Option<u32>,

    /// Time before frame 1 that is simulated but not written, in which pins go from the mesh's own positions to where
    /// they are at frame 1, and the cloth settles [default: 0]
    #[arg(long, value_name = "SECONDS", value_parser = not_negative, allow_hyphen_values = true)]
    pub(crate) preroll: Option<f32>,

    /// Frames per second [default: 60]
    #[arg(long, value_name = "F", value_parser = rate, allow_hyphen_values = true)]
    pub(crate) fps: Option<f32>,

    /// Processor that runs the simulation; auto selects a GPU if there is one and the mesh is large enough to benefit
    /// [default: auto]
    #[arg(long, value_parser = one_of(&BACKENDS))]
    pub(crate) backend: Option<Backend>,

    /// Solver for the edges [default: small-steps]
    #[arg(long, value_parser = one_of(&METHODS))]
    pub(crate) method: Option<Method>,

    /// Substeps per 1/60 s; longer frames take more, so that substeps are never longer
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), conflicts_with = "strain", allow_hyphen_values = true)]
    pub(crate) substeps: Option<u32>,

    /// Bound on the stretch of 99 % of the area; the number of substeps follows from it [default: 0.03]
    #[arg(long, value_name = "T", value_parser = positive, allow_hyphen_values = true)]
    pub(crate) strain: Option<f32>,

    /// Sweeps per substep, for --method relaxation [default: 20]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), allow_hyphen_values = true)]
    pub(crate) iterations: Option<u32>,

    /// Coarse levels, which keep fine cloth from stretching: where they pay off, or none [default: auto]
    #[arg(long, value_name = "WHICH", value_parser = one_of(&LEVELS))]
    pub(crate) levels: Option<Levels>,

    /// Material of the cloth [default: towel]
    #[arg(long, value_name = "NAME", value_parser = one_of(Fabric::PRESETS))]
    pub(crate) fabric: Option<Fabric>,

    /// Pinned vertices: none; top: the highest ones, or the side of lowest z if the mesh is horizontal; corners: the
    /// four nearest to the corners of its bounding rectangle; or vertex numbers from 0, in the file's order [default:
    /// none]
    #[arg(long, value_name = "none|top|corners|INDEX,INDEX..", allow_hyphen_values = true)]
    pub(crate) pin: Option<Pin>,

    /// A sphere: center and radius; may be repeated. Without a sphere, a capsule, a box or a body, there is a sphere
    /// below the mesh: its top is lower by 0.1 of the mesh's largest extent, and its radius is 0.3 of that extent; of
    /// 1 m for the towel, times --scale
    #[arg(long, value_name = "X,Y,Z,R", value_parser = ball, conflicts_with = "no_sphere", allow_hyphen_values = true)]
    pub(crate) sphere: Vec<Collider>,

    /// A capsule: the ends of its axis and its radius, or one radius for each end; may be repeated
    #[arg(long, value_name = "X,Y,Z,X,Y,Z,R[,R]", value_parser = capsule, allow_hyphen_values = true)]
    pub(crate) capsule: Vec<Collider>,

    /// A box: center, half of its width, height and depth, and the radius of its edges; may be repeated
    #[arg(long = "box", value_name = "X,Y,Z,W,H,D[,R]", value_parser = solid_box, allow_hyphen_values = true)]
    pub(crate) solid_box: Vec<Collider>,

    /// A mesh collider, which holds cloth on both sides; may be repeated. With `####` in its name, unless that is
    /// the name of a file, numbered files, one for each frame from 1 on, between which its vertices move in straight lines
    #[arg(long, value_name = "FILE.obj")]
    pub(crate) body: Vec<PathBuf>,

    /// A plane: a point on it, and its normal pointing out of the solid; may be repeated
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = plane, conflicts_with = "no_floor", allow_hyphen_values = true)]
    pub(crate) plane: Vec<Collider>,

    /// No sphere, neither a default one nor those of a scene
    #[arg(long)]
    pub(crate) no_sphere: bool,

    /// Height of the floor [default, without a plane: 0.7 of the mesh's largest extent below the mesh; of 1 m for the
    /// towel, times --scale]
    #[arg(long, value_name = "Y", value_parser = finite, conflicts_with = "no_floor", allow_hyphen_values = true)]
    pub(crate) floor: Option<f32>,

    /// No plane, neither a default one nor those of a scene
    #[arg(long)]
    pub(crate) no_floor: bool,

    /// Gravity (m/s2) [default: 0,-9.81,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) gravity: Option<Vec3>,

    /// Velocity of the air (m/s), with a density of 1.225 kg/m3; without this option there is no air
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) wind: Option<Vec3>,

    /// Contact of the cloth with itself, at this thickness (m) [default: 0.005]
    #[arg(long, value_name = "METERS", num_args = 0..=1, default_missing_value = "0.005", value_parser = thickness, allow_negative_numbers = true)]
    pub(crate) self_contact: Option<f32>,

    /// Separate cloth that crosses itself or a mesh collider, before the first frame and every 0.2 s later; crossings that remain are reported
    #[arg(long)]
    pub(crate) untangle: bool,

    /// Coefficient of friction with all colliders and of the cloth with itself [default: 0.3]
    #[arg(long, value_name = "MU", value_parser = not_negative, allow_hyphen_values = true)]
    pub(crate) friction: Option<f32>,

    /// File formats of the frames, separated by commas: obj, one file per frame; pc2, mdd or usda, all frames in one
    /// file, `cloth.pc2` and so on, in --out [default: obj]
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', value_parser = one_of(&FORMATS))]
    pub(crate) format: Vec<Format>,

    /// Also write all frames to a PC2 point cache, as read by Blender's Mesh Cache modifier and others
    #[arg(long, value_name = "FILE.pc2")]
    pub(crate) pc2: Option<PathBuf>,

    /// Save the state of the run every --every frames, for --resume
    #[arg(long, value_name = "FILE")]
    pub(crate) save: Option<PathBuf>,

    /// Number of frames between saves
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = value_parser!(u32).range(1..), requires = "save", allow_hyphen_values = true)]
    pub(crate) every: u32,

    /// Continue from the state in this file with the same arguments; earlier frames must be in --out
    #[arg(long, value_name = "FILE")]
    pub(crate) resume: Option<PathBuf>,

    /// Draw a contact sheet of twelve frames
    #[arg(long, value_name = "FILE.png")]
    pub(crate) preview: Option<PathBuf>,

    /// Draw an animation of the run in real time, with at most 30 frames per second: an animated PNG, which browsers play
    #[arg(long, value_name = "FILE.png")]
    pub(crate) animate: Option<PathBuf>,

    /// Write measurements and all warnings of every frame (JSON); "ms" is the time of the step alone, without measuring, reading back from
    /// a GPU and writing files
    #[arg(long, value_name = "FILE.json")]
    pub(crate) report: Option<PathBuf>,

    /// Print no progress bar and no summary, only warnings and errors
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Other tasks of the program.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum Task {
    /// Compares the OBJ frames of two runs, positions first: prints the first frame and vertex in which they differ, or
    /// else the first line, and why; the exit code is 0 if they are equal, 1 if not
    Diff {
        /// Folder with the OBJ frames of one run, `frame_0001.obj` and so on
        a: PathBuf,
        /// Folder with those of the other
        b: PathBuf,
    },
}

fn finite(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) => Err("it must be finite".to_owned()),
        Err(_) => Err(format!("`{text}` is not a number")),
    }
}

fn positive(text: &str) -> Result<f32, String> {
    finite(text).and_then(|number| if number > 0.0 { Ok(number) } else { Err("it must be above 0".to_owned()) })
}

fn not_negative(text: &str) -> Result<f32, String> {
    finite(text).and_then(|number| if number >= 0.0 { Ok(number) } else { Err("it must be 0 or above".to_owned()) })
}

/// A value that may be missing, so that what comes next is taken for it.
fn thickness(text: &str) -> Result<f32, String> {
    let hint = "give the thickness, `--self-contact=0.005`, or put MESH.obj before this option";
    if text.trim().parse::<f32>().is_ok() { positive(text) } else { Err(format!("`{text}` is not a number; {hint}")) }
}

/// Most frames a second: a step takes at least a nanosecond.
const MAX_FPS: f32 = 1e9;

/// Frames a second, between which a step must have a length that can be computed.
pub(crate) fn check_rate(fps: f32) -> Result<f32, String> {
    match (1.0 / fps).is_finite() {
        true if fps <= MAX_FPS => Ok(fps),
        true => Err(format!("a frame of 1/{fps} seconds is too short; give at most {MAX_FPS} frames a second")),
        false => Err(format!("a frame of 1/{fps} seconds is not finite; give more frames a second")),
    }
}

fn rate(text: &str) -> Result<f32, String> {
    positive(text).and_then(check_rate)
}

fn numbers<const N: usize>(text: &str) -> Result<[f32; N], String> {
    let values = text.split(',').map(finite).collect::<Result<Vec<f32>, String>>()?;
    let given = values.len();
    values.try_into().map_err(|_| format!("it has {given} numbers; give {N}, with commas between"))
}

fn vector(text: &str) -> Result<Vec3, String> {
    numbers(text).map(Vec3::from_array)
}

fn variants(text: &str) -> Result<RangeInclusive<u32>, String> {
    let number = |word: &str| word.trim().parse::<u32>().ok().filter(|&number| number > 0);
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    match (number(first), number(last)) {
        (Some(first), Some(last)) if first <= last => Ok(first..=last),
        _ => Err("give a number from 1 on, or a first and a last one, 1-10".to_owned()),
    }
}

fn ball(text: &str) -> Result<Collider, String> {
    let [x, y, z, radius] = numbers(text)?;
    above_0("the radius", radius)?;
    Ok(Collider::sphere(Vec3::new(x, y, z), radius))
}

fn capsule(text: &str) -> Result<Collider, String> {
    let [ends @ .., ra, rb] = numbers_or(text, |[ends @ .., radius]: [f32; 7]| {
        let [ax, ay, az, bx, by, bz] = ends;
        [ax, ay, az, bx, by, bz, radius, radius]
    })?;
    let [ax, ay, az, bx, by, bz] = ends;
    [ra, rb].into_iter().try_for_each(|radius| above_0("a radius", radius))?;
    let (a, b) = (Vec3::new(ax, ay, az), Vec3::new(bx, by, bz));
    Ok(if ra == rb { Collider::capsule(a, b, ra) } else { Collider::tapered_capsule(a, ra, b, rb) })
}

fn solid_box(text: &str) -> Result<Collider, String> {
    let [x, y, z, w, h, d, radius] = numbers_or(text, |[x, y, z, w, h, d]: [f32; 6]| [x, y, z, w, h, d, 0.0])?;
    [w, h, d].into_iter().try_for_each(|half| above_0("half of its width, height and depth", half))?;
    let half = Vec3::new(w, h, d);
    if (0.0..=half.min_element()).contains(&radius) {
        Ok(Collider::rounded_box(Vec3::new(x, y, z), half, Quat::IDENTITY, radius))
    } else {
        Err(format!("the radius must be from 0 to {}, the least of W, H and D", half.min_element()))
    }
}

fn plane(text: &str) -> Result<Collider, String> {
    let [x, y, z, nx, ny, nz] = numbers(text)?;
    let normal = Vec3::new(nx, ny, nz);
    let has_direction = normal.as_dvec3().try_normalize().is_some();
    has_direction
        .then(|| Collider::plane(Vec3::new(x, y, z), normal))
        .ok_or_else(|| "its normal has no direction; give a vector out of the solid".to_owned())
}

fn above_0(what: &str, number: f32) -> Result<(), String> {
    if number > 0.0 { Ok(()) } else { Err(format!("{what} must be above 0")) }
}

/// `N` numbers, or as few as `M`, which are made up to as many.
fn numbers_or<const M: usize, const N: usize>(text: &str, complete: impl Fn([f32; M]) -> [f32; N]) -> Result<[f32; N], String> {
    match text.split(',').count() {
        given if given == M => numbers(text).map(complete),
        given if given == N => numbers(text),
        given => Err(format!("it has {given} numbers; give {M} or {N}, with commas between")),
    }
}
