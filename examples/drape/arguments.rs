//! The command line: what can be said, and what each word means.

use std::{ops::RangeInclusive, path::PathBuf};

use clap::{Parser, Subcommand, value_parser};
use cloth_deformer::{
    Backend, Collider, Fabric, Levels, Method,
    glam::{Quat, Vec3},
};

use crate::{
    Failure,
    command::{self, one_of},
    pins::Pin,
};

/// Names of the backends.
pub(crate) const BACKENDS: [(&str, Backend); 4] =
    [("auto", Backend::Auto), ("cpu", Backend::Cpu), ("hybrid", Backend::Hybrid), ("gpu", Backend::Gpu)];

/// Names of the methods.
pub(crate) const METHODS: [(&str, Method); 3] =
    [("small-steps", Method::SmallSteps), ("relaxation", Method::Relaxation { iterations: 20 }), ("springs", Method::Springs)];
/// Names of the levels.
pub(crate) const LEVELS: [(&str, Levels); 2] = [("auto", Levels::Auto), ("off", Levels::Off)];

/// What frames are written as.
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

/// Drapes cloth over what there is, and writes every frame as an OBJ file.
///
/// Lengths are meters, masses kilograms, y is up. Without a mesh or a scene, a towel of 1.2 m x 1.2 m and 64 x 64 vertices falls from 0.7 m.
#[derive(Debug, Clone, Parser)]
#[command(
    name = "drape",
    args_conflicts_with_subcommands = true,
    disable_help_subcommand = true,
    after_help = "\
Frame 1 is the mesh as it was given; each further frame is one step of 1/FPS seconds. Vertices and faces keep their order, and frames all
that the file had besides: polygons, texture coordinates, groups, materials; normals turn with the cloth. Frames of a longer run before
that are still in --out are not mixed with this one's: it says so, and ends.
Exit codes: 0 done, 1 different (diff), 2 bad input, 3 unstable, 4 no such GPU, 130 interrupted. Files are written whole or not at all."
)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) task: Option<Task>,

    /// The cloth; any triangles or polygons. Default: the towel
    #[arg(value_name = "MESH.obj")]
    pub(crate) mesh: Option<PathBuf>,

    /// A scene: cloths, pins, colliders, wind, and how they move; what else is said here takes the place of what it says. See
    /// examples/scenes
    #[arg(long, value_name = "FILE.toml")]
    pub(crate) scene: Option<PathBuf>,

    /// How many variants the scene's [[vary]] make, and no more
    #[arg(long, requires = "scene", conflicts_with = "variant")]
    pub(crate) list: bool,

    /// Runs a variant of the scene, from 1 on, or several, into a folder each in --out, `variant_0001` and so on, with a receipt. They are there
    /// whole or not at all, and not run again once they are there
    #[arg(long, value_name = "I|I-J", requires = "scene", conflicts_with_all = ["save", "resume"], value_parser = variants)]
    pub(crate) variant: Option<RangeInclusive<u32>>,

    /// What the mesh's coordinates are multiplied by: 0.01 if they are centimeters [default: 1]
    #[arg(long, value_name = "S", value_parser = positive, allow_hyphen_values = true)]
    pub(crate) scale: Option<f32>,

    /// Directory of the frames, `frame_0001.obj` and so on; made if it is not there [default: frames]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,

    /// Number of frames, the rest state included [default: 120]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), allow_hyphen_values = true)]
    pub(crate) frames: Option<u32>,

    /// Frames a second [default: 60]
    #[arg(long, value_name = "F", value_parser = rate, allow_hyphen_values = true)]
    pub(crate) fps: Option<f32>,

    /// Where the work is done; auto takes a GPU if there is one and the mesh is large enough to gain from it [default: auto]
    #[arg(long, value_parser = one_of(&BACKENDS))]
    pub(crate) backend: Option<Backend>,

    /// How the edges hold together [default: small-steps]
    #[arg(long, value_parser = one_of(&METHODS))]
    pub(crate) method: Option<Method>,

    /// Substeps in 1/60 s; frames of another length take as many as keep them no longer
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), conflicts_with = "strain", allow_hyphen_values = true)]
    pub(crate) substeps: Option<u32>,

    /// Strain to stay below, by as many substeps as that takes [default: 0.03]
    #[arg(long, value_name = "T", value_parser = positive, allow_hyphen_values = true)]
    pub(crate) strain: Option<f32>,

    /// Sweeps a substep, for --method relaxation [default: 20]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), allow_hyphen_values = true)]
    pub(crate) iterations: Option<u32>,

    /// Corrections on coarser cloths, which keep fine cloth from stretching: as many as pay, or none [default: auto]
    #[arg(long, value_name = "WHICH", value_parser = one_of(&LEVELS))]
    pub(crate) levels: Option<Levels>,

    /// What the cloth is made of [default: towel]
    #[arg(long, value_name = "NAME", value_parser = one_of(Fabric::PRESETS))]
    pub(crate) fabric: Option<Fabric>,

    /// Vertices that stay where they are: none; top: the highest ones, or the side of lowest z if the mesh lies flat;
    /// corners: the four nearest the corners of its bounding rectangle; or vertex numbers from 0, in the file's order [default: none]
    #[arg(long, value_name = "none|top|corners|INDEX,INDEX..", allow_hyphen_values = true)]
    pub(crate) pin: Option<Pin>,

    /// A sphere: center and radius; as often as there are spheres. Without a sphere, a capsule, a box or a body, there is a sphere below the mesh, its
    /// top 0.1 of the mesh's largest extent lower, its radius 0.3 of it
    #[arg(long, value_name = "X,Y,Z,R", value_parser = ball, conflicts_with = "no_sphere", allow_hyphen_values = true)]
    pub(crate) sphere: Vec<Collider>,

    /// A capsule: the ends of its axis and its radius, or one at each end
    #[arg(long, value_name = "X,Y,Z,X,Y,Z,R[,R]", value_parser = capsule, allow_hyphen_values = true)]
    pub(crate) capsule: Vec<Collider>,

    /// A box: center, half of its width, height and depth, and the radius of its edges
    #[arg(long = "box", value_name = "X,Y,Z,W,H,D[,R]", value_parser = solid_box, allow_hyphen_values = true)]
    pub(crate) solid_box: Vec<Collider>,

    /// A body of triangles, which holds cloth on both sides; with `####` in its name numbered files, one for each frame from 1 on, between which
    /// its vertices go straight
    #[arg(long, value_name = "FILE.obj")]
    pub(crate) body: Vec<PathBuf>,

    /// A plane: a point of it, and its normal out of the solid
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = plane, conflicts_with = "no_floor", allow_hyphen_values = true)]
    pub(crate) plane: Vec<Collider>,

    /// No sphere
    #[arg(long)]
    pub(crate) no_sphere: bool,

    /// Height of the floor [default, without a plane: 0.7 of the mesh's largest extent below the mesh]
    #[arg(long, value_name = "Y", value_parser = finite, conflicts_with = "no_floor", allow_hyphen_values = true)]
    pub(crate) floor: Option<f32>,

    /// No floor
    #[arg(long)]
    pub(crate) no_floor: bool,

    /// Gravity (m/s2) [default: 0,-9.81,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) gravity: Option<Vec3>,

    /// Velocity of the air (m/s), which has 1.225 kg/m3; without this there is no air
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) wind: Option<Vec3>,

    /// The cloth cannot pass through itself: it keeps this far apart (m) [default: 0.005]
    #[arg(long, value_name = "METRES", num_args = 0..=1, default_missing_value = "0.005", value_parser = positive)]
    pub(crate) self_contact: Option<f32>,

    /// Parts cloth that goes through itself or through a body at the start, before the first frame; what cannot be parted is reported
    #[arg(long)]
    pub(crate) untangle: bool,

    /// Coefficient of friction with all colliders and itself [default: 0.3]
    #[arg(long, value_name = "MU", value_parser = not_negative, allow_hyphen_values = true)]
    pub(crate) friction: Option<f32>,

    /// What frames are written as, with commas between: obj, a file each; pc2, mdd or usda, all in one file, `cloth.pc2` and so on, in --out
    /// [default: obj]
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', value_parser = one_of(&FORMATS))]
    pub(crate) format: Vec<Format>,

    /// All frames in one point cache as well, for Blender's Mesh Cache modifier and its kin
    #[arg(long, value_name = "FILE.pc2")]
    pub(crate) pc2: Option<PathBuf>,

    /// Where the run is, every so many frames, for --resume
    #[arg(long, value_name = "FILE")]
    pub(crate) save: Option<PathBuf>,

    /// Frames from --save to --save
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = value_parser!(u32).range(1..), requires = "save", allow_hyphen_values = true)]
    pub(crate) every: u32,

    /// Goes on where --save left off, with the same arguments: frames after that are written, those before are in --out
    #[arg(long, value_name = "FILE")]
    pub(crate) resume: Option<PathBuf>,

    /// A contact sheet of twelve frames
    #[arg(long, value_name = "FILE.png")]
    pub(crate) preview: Option<PathBuf>,

    /// Figures of every frame; "ms" is the step alone, without measuring, reading back from a GPU or writing files
    #[arg(long, value_name = "FILE.json")]
    pub(crate) report: Option<PathBuf>,

    /// No progress bar and no summary; warnings and errors remain
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// What else the program does.
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum Task {
    /// Names the first frame and vertex in which two runs differ, and why; exit code 0 if they do not, 1 if they do
    Diff {
        /// Folder of the frames of one run
        a: PathBuf,
        /// Folder of the frames of the other
        b: PathBuf,
    },
}

impl Arguments {
    /// The arguments this process was given, or the help that was asked for.
    pub(crate) fn read() -> Result<Result<Arguments, clap::Error>, Failure> {
        command::read()
    }
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

/// Frames a second: the step they leave must be a number too.
fn rate(text: &str) -> Result<f32, String> {
    positive(text).and_then(|fps| {
        let dt = 1.0 / fps;
        if dt.is_finite() && dt > 0.0 { Ok(fps) } else { Err("a step of 1/FPS seconds is not finite".to_owned()) }
    })
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
    match (0.0..=half.min_element()).contains(&radius) {
        true => Ok(Collider::rounded_box(Vec3::new(x, y, z), half, Quat::IDENTITY, radius)),
        false => Err(format!("the radius must be from 0 to {}, the least of W, H and D", half.min_element())),
    }
}

fn plane(text: &str) -> Result<Collider, String> {
    let [x, y, z, nx, ny, nz] = numbers(text)?;
    let normal = Vec3::new(nx, ny, nz);
    let has_direction = normal.as_dvec3().try_normalize().is_some();
    has_direction.then(|| Collider::plane(Vec3::new(x, y, z), normal)).ok_or_else(|| "its normal has no direction".to_owned())
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
