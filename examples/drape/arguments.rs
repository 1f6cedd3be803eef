//! The command line: what can be said, and what each word means.

use std::path::PathBuf;

use clap::{Parser, value_parser};
use cloth_deformer::{Backend, Fabric, Levels, Method, glam::Vec3};

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
const LEVELS: [(&str, Levels); 2] = [("auto", Levels::Auto), ("off", Levels::Off)];

/// What frames are written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    Obj,
    Pc2,
    Mdd,
    Usda,
}

const FORMATS: [(&str, Format); 4] = [("obj", Format::Obj), ("pc2", Format::Pc2), ("mdd", Format::Mdd), ("usda", Format::Usda)];

/// Drapes a cloth over a sphere and a floor, and writes every frame as an OBJ file.
///
/// Lengths are meters, masses kilograms, y is up. Without a mesh, a towel of 1.2 m x 1.2 m and 64 x 64 vertices falls from 0.7 m.
#[derive(Debug, Parser)]
#[command(
    name = "drape",
    after_help = "\
Frame 1 is the mesh as it was given; each further frame is one step of 1/FPS seconds. Vertices and faces keep their order, and frames all
that the file had besides: polygons, texture coordinates, groups, materials; normals turn with the cloth. Frames of a longer run before
that are still in --out are not mixed with this one's: it says so, and ends.
Exit codes: 0 done, 2 bad input, 3 unstable, 4 no such GPU, 130 interrupted. Files are written whole or not at all."
)]
pub(crate) struct Arguments {
    /// The cloth; any triangles or polygons. Default: the towel
    #[arg(value_name = "MESH.obj")]
    pub(crate) mesh: Option<PathBuf>,

    /// Directory of the frames, `frame_0001.obj` and so on; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "frames")]
    pub(crate) out: PathBuf,

    /// Number of frames, the rest state included
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = value_parser!(u32).range(1..), allow_hyphen_values = true)]
    pub(crate) frames: u32,

    /// Frames a second
    #[arg(long, value_name = "F", default_value = "60", value_parser = rate, allow_hyphen_values = true)]
    fps: f32,

    /// Where the work is done; auto takes a GPU if there is one and the mesh is large enough to gain from it
    #[arg(long, default_value = "auto", value_parser = one_of(&BACKENDS))]
    pub(crate) backend: Backend,

    /// How the edges hold together
    #[arg(long, default_value = "small-steps", value_parser = one_of(&METHODS))]
    method: Method,

    /// Substeps in 1/60 s; frames of another length take as many as keep them no longer
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), conflicts_with = "strain", allow_hyphen_values = true)]
    pub(crate) substeps: Option<u32>,

    /// Strain to stay below, by as many substeps as that takes [default: 0.03]
    #[arg(long, value_name = "T", value_parser = positive, allow_hyphen_values = true)]
    pub(crate) strain: Option<f32>,

    /// Sweeps a substep, for --method relaxation [default: 20]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..), allow_hyphen_values = true)]
    iterations: Option<u32>,

    /// Corrections on coarser cloths, which keep fine cloth from stretching: as many as pay, or none
    #[arg(long, value_name = "WHICH", default_value = "auto", value_parser = one_of(&LEVELS))]
    pub(crate) levels: Levels,

    /// What the cloth is made of
    #[arg(long, value_name = "NAME", default_value = "towel", value_parser = one_of(Fabric::PRESETS))]
    pub(crate) fabric: Fabric,

    /// Vertices that stay where they are: none; top: the highest ones, or the side of lowest z if the mesh lies flat;
    /// corners: the four nearest the corners of its bounding rectangle; or vertex numbers from 0, in the file's order
    #[arg(long, value_name = "none|top|corners|INDEX,INDEX..", default_value = "none", allow_hyphen_values = true)]
    pub(crate) pin: Pin,

    /// A sphere: center and radius [default: radius 0.3 of the mesh's largest extent, its top 0.1 of it below the mesh]
    #[arg(long, value_name = "X,Y,Z,R", value_parser = ball, conflicts_with = "no_sphere", allow_hyphen_values = true)]
    pub(crate) sphere: Option<Ball>,

    /// No sphere
    #[arg(long)]
    pub(crate) no_sphere: bool,

    /// Height of the floor [default: under the default sphere, 0.7 of the mesh's largest extent below the mesh]
    #[arg(long, value_name = "Y", value_parser = finite, conflicts_with = "no_floor", allow_hyphen_values = true)]
    pub(crate) floor: Option<f32>,

    /// No floor
    #[arg(long)]
    pub(crate) no_floor: bool,

    /// Gravity (m/s2)
    #[arg(long, value_name = "X,Y,Z", default_value = "0,-9.81,0", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) gravity: Vec3,

    /// Velocity of the air (m/s), which has 1.225 kg/m3; without this there is no air
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub(crate) wind: Option<Vec3>,

    /// The cloth cannot pass through itself: it keeps this far apart (m) [default: 0.005]
    #[arg(long, value_name = "METRES", num_args = 0..=1, default_missing_value = "0.005", value_parser = positive)]
    pub(crate) self_contact: Option<f32>,

    /// Coefficient of friction with the sphere, the floor and itself [default: 0.3]
    #[arg(long, value_name = "MU", value_parser = not_negative, allow_hyphen_values = true)]
    pub(crate) friction: Option<f32>,

    /// What frames are written as, with commas between: obj, a file each; pc2, mdd or usda, all in one file, `cloth.pc2` and so on, in --out
    #[arg(long, value_name = "FORMATS", default_value = "obj", value_delimiter = ',', value_parser = one_of(&FORMATS))]
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

/// A sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ball {
    pub(crate) center: Vec3,
    pub(crate) radius: f32,
}

impl Arguments {
    /// The arguments this process was given, or the help that was asked for.
    pub(crate) fn read() -> Result<Result<Arguments, clap::Error>, Failure> {
        match command::read::<Arguments>()? {
            Ok(arguments) => arguments.checked().map(Ok),
            Err(help) => Ok(Err(help)),
        }
    }

    /// What no value can say alone.
    fn checked(self) -> Result<Arguments, Failure> {
        if self.iterations.is_some() && !matches!(self.method, Method::Relaxation { .. }) {
            return Err(Failure::input("--iterations belongs to --method relaxation; add that, or leave it out"));
        }
        if (self.save.is_some() || self.resume.is_some()) && !self.writes(Format::Obj) {
            return Err(Failure::input("--save and --resume need the frames as OBJ files; add obj to --format"));
        }
        Ok(self)
    }

    /// The method, with its iterations.
    pub(crate) fn method(&self) -> Method {
        match (self.method, self.iterations) {
            (Method::Relaxation { .. }, Some(iterations)) => Method::Relaxation { iterations },
            (method, _) => method,
        }
    }

    /// Whether frames are written so.
    pub(crate) fn writes(&self, format: Format) -> bool {
        self.format.contains(&format)
    }

    /// Frames a second.
    pub(crate) fn fps(&self) -> f32 {
        self.fps
    }

    /// The time step (s).
    pub(crate) fn dt(&self) -> f32 {
        1.0 / self.fps
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

fn ball(text: &str) -> Result<Ball, String> {
    let [x, y, z, radius] = numbers(text)?;
    if radius > 0.0 { Ok(Ball { center: Vec3::new(x, y, z), radius }) } else { Err("the radius must be above 0".to_owned()) }
}
