//! What a scene needs: the cheapest method, substeps, levels and terms that keep a tolerance, found by playing it.
//!
//! A run that resolves the stiffness is what the others are compared with; the same once more, with more substeps and each vertex moved by ten
//! micrometers, shows how far that itself can be trusted. Where the two part by more than half of the tolerance the motion is chaotic: no
//! setting repeats it, and runs are compared by where there is cloth and how fast it moves. Then each term that the scene has is left out
//! once, and those that together make less than half of the tolerance are dropped. Then substeps are halved, for each kind of solver
//! that could still be cheaper, until the tolerance is missed, and one is tried between. What is chosen is checked on frames that
//! the search did not look at.

mod clip;
mod distance;
mod search;

use std::fmt::{self, Display, Formatter};

use crate::attributes::Attributes;
use crate::error::BuildError;
use crate::model::mesh::Mesh;
use crate::options::{Levels, Method, Options, Quality, Tethers};
use clip::Scene;
use search::Search;

/// What a run may be off by.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Tolerance {
    /// Root mean square distance (mm) of the vertices from where a resolved run has them, in the worst frame.
    Position(f32),
    /// Stretch that 99 per cent of the cloth's area is not to exceed, in all but one frame of a hundred.
    Strain(f32),
}

/// What a search varies.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Setting {
    /// [`Options::method`].
    pub method: Method,
    /// [`Options::quality`].
    pub quality: Quality,
    /// [`Options::levels`].
    pub levels: Levels,
    /// [`Options::tethers`].
    pub tethers: Tethers,
    /// Whether the fabric's bending, its damping and the air count; each only if the scene has it.
    pub terms: [bool; 3],
}

/// A run that was tried.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Trial {
    /// With what.
    pub setting: Setting,
    /// Substeps of a frame, the mean.
    pub substeps: f32,
    /// Most coarse levels that were in use.
    pub levels: u32,
    /// Error, as the tolerance counts it: mm or strain; infinite if the run could not be finished.
    pub error: f32,
    /// The same on frames that the search does not go by.
    pub checked: f32,
    /// Time of a frame of 1/60 s (ms), as long as nothing else is in its way.
    pub milliseconds: f32,
}

/// What a term of the scene is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Term {
    /// `bending`, `damping` or `air`.
    pub name: &'static str,
    /// What the cloth is off by (mm) without it.
    pub error: f32,
    /// What a frame is shorter by (ms) without it, at an eighth of the resolved substeps.
    pub milliseconds: f32,
    /// Whether it was dropped.
    pub dropped: bool,
}

/// What a search found.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Tuned {
    /// The cheapest run that kept the tolerance, also in the frames that it was checked on.
    pub best: Trial,
    /// The options for it. [`Setting::attributes`] says whether the scene's air is to be left out.
    pub options: Options,
    /// The run that resolves the stiffness; its error (mm) is how far it can be trusted. None where strain is asked for.
    pub resolved: Option<Trial>,
    /// Whether no two runs repeat the motion, so that its statistics were compared.
    pub chaotic: bool,
    /// The terms that the scene has.
    pub terms: Vec<Term>,
    /// All that was tried.
    pub trials: Vec<Trial>,
}

impl Setting {
    fn of(options: &Options) -> Setting {
        let &Options { method, quality, levels, tethers, .. } = options;
        Setting { method, quality, levels, tethers, terms: [true; 3] }
    }

    fn with_substeps(self, count: u32) -> Setting {
        Setting { quality: Quality::Substeps(count), ..self }
    }

    /// These options with the setting.
    #[must_use]
    pub fn options(&self, options: &Options) -> Options {
        let &Setting { method, quality, levels, tethers, terms: [bending, damping, _] } = self;
        let mut fabric = options.fabric;
        fabric.bending *= f32::from(u8::from(bending));
        fabric.damping *= f32::from(u8::from(damping));
        Options { method, quality, levels, tethers, fabric, ..options.clone() }
    }

    /// These attributes with the setting: without air if that does not count.
    #[must_use]
    pub fn attributes(&self, attributes: Attributes) -> Attributes {
        let air_density = if self.terms[2] { attributes.air_density } else { 0.0 };
        Attributes { air_density, ..attributes }
    }
}

/// As fields to paste into [`Options`].
impl Display for Setting {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Setting { method, quality, levels, tethers, terms: [bending, damping, air] } = self;
        write!(
            f,
            "method: Method::{method:?}, quality: Quality::{quality:?}, levels: Levels::{levels:?}, tethers: Tethers::{tethers:?}"
        )?;
        match (bending, damping) {
            (true, true) => {}
            (true, false) => write!(f, ", fabric: Fabric {{ damping: 0.0, ..fabric }}")?,
            (false, _) => write!(f, ", fabric: Fabric {{ bending: 0.0, damping: 0.0, ..fabric }}")?,
        }
        if *air { Ok(()) } else { write!(f, " // and Attributes {{ air_density: 0.0, .. }}") }
    }
}

/// Finds the cheapest method, substeps, coarse levels and terms that keep a tolerance in a scene: `mesh` with `options`, under
/// `attributes` of each frame of 1/60 s, numbered from 1, for some `frames`.
///
/// Plays the scene up to 20 times, one of them resolved, which is what takes the time: some three times what the resolved run does.
/// Times are of this machine, as busy as it is.
///
/// # Errors
/// As [`Deformer::new`](crate::Deformer::new); if the tolerance is no number above 0 or there are no frames; and if a step of the resolved run fails, with its
/// frame.
pub fn tune(
    mesh: &Mesh,
    options: &Options,
    attributes: impl Fn(u32) -> Attributes,
    frames: u32,
    tolerance: Tolerance,
) -> Result<Tuned, BuildError> {
    let (Tolerance::Position(most) | Tolerance::Strain(most)) = tolerance;
    let value = |name: &str, value: String, remedy| BuildError::Value { name: name.into(), value, remedy };
    if !(most > 0.0 && most.is_finite()) {
        return Err(value("tolerance", most.to_string(), "it must be finite and above 0"));
    }
    if frames == 0 {
        return Err(value("frames", frames.to_string(), "a scene has at least one"));
    }
    Search::new(Scene { mesh, options, attributes: &attributes, frames }, f64::from(most)).run(tolerance)
}
