//! Finds the cheapest method, substeps, levels and terms that keep a tolerance in a scene, by simulating it.
//!
//! A run that resolves the stiffness is the reference. A second such run, with more substeps and every vertex displaced
//! by up to ten micrometers, shows how far the reference can be trusted. If the two differ by more than half of the
//! tolerance the motion is chaotic: no setting repeats it, and runs are compared by where there is cloth and how fast
//! it moves. Then each term of the scene is left out once, and the terms that together change the motion by less than
//! half of the tolerance are dropped. Then, for each kind of solver that could still be cheaper, the number of substeps
//! is halved until the tolerance is missed, and one number in between is tried. The result is verified on frames that
//! the search did not use.

mod clip;
mod distance;
mod search;

use std::fmt::{self, Display, Formatter};

use crate::attributes::Attributes;
use crate::error::BuildError;
use crate::model::checks::check_mesh;
use crate::model::mesh::{Mesh, has_edges};
use crate::options::{Levels, Method, Options, Quality, Tethers};
use clip::Scene;
use search::Search;

/// The error that a run may have.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Tolerance {
    /// Root mean square distance (mm) of the vertices that triangles use from those of a resolved run, in the worst frame.
    Position(f32),
    /// Stretch that 99 percent of the cloth's area may not exceed, in all but one frame of a hundred.
    Strain(f32),
}

/// The settings that a search varies.
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
    /// What is computed.
    pub terms: Terms,
}

/// The terms of a scene that can be left out, and whether they are computed; each applies only if the scene has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Terms {
    /// [`Fabric::bending`](crate::Fabric::bending).
    pub bending: bool,
    /// [`Fabric::damping`](crate::Fabric::damping), which acts on bending.
    pub damping: bool,
    /// [`Attributes::air_density`].
    pub air: bool,
}

impl Terms {
    /// Nothing is left out.
    pub const ALL: Terms = Terms { bending: true, damping: true, air: true };

    /// The names of the terms that are left out.
    pub fn left_out(self) -> impl Iterator<Item = &'static str> {
        let Terms { bending, damping, air } = self;
        [("bending", bending), ("damping", damping), ("air", air)]
            .into_iter()
            .filter_map(|(name, is_there)| (!is_there).then_some(name))
    }
}

/// A run that was tried.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Trial {
    /// The settings of the run.
    pub setting: Setting,
    /// Mean number of substeps per frame.
    pub substeps: f32,
    /// Largest number of coarse levels used.
    pub levels: u32,
    /// Error in the unit of the tolerance, mm or strain; infinite if the run failed.
    pub error: f32,
    /// The same error on the frames that the search does not use.
    pub checked: f32,
    /// Time per frame of 1/60 s (ms): the mean number of substeps times the lower quartile of the time of one, which leaves out short
    /// disturbances.
    pub milliseconds: f32,
}

/// The cost and the effect of a term of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Term {
    /// `bending`, `damping` or `air`.
    pub name: &'static str,
    /// Error of the cloth (mm) without it.
    pub error: f32,
    /// Time saved per frame (ms) without it, at an eighth of the substeps that resolve the stiffness.
    pub milliseconds: f32,
    /// Whether the search left it out.
    pub dropped: bool,
}

/// The result of a search.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Tuned {
    /// The cheapest run that kept the tolerance, also in the frames that verify it; if [`Tuned::kept`] is false, the run with
    /// the least error in all frames.
    pub best: Trial,
    /// Whether any run kept the tolerance, or what was [`allowed`](Tuned::allowed) instead of it because the motion is chaotic: compare
    /// the two where the tolerance itself matters. None does if it is smaller than what the substeps leave at their shortest.
    pub kept: bool,
    /// The options of that run. [`Setting::attributes`] says whether the scene's air can be left out.
    pub options: Options,
    /// The error that a run was allowed, in the unit of the tolerance: less than it by what the reference is uncertain by, or
    /// one and a half times that uncertainty if the motion is chaotic and that is more.
    pub allowed: f32,
    /// The reference run, whose error (mm) says how far it can be trusted. `None` if the tolerance is a strain.
    pub resolved: Option<Trial>,
    /// Whether the motion is chaotic, so that statistics of runs were compared instead of positions.
    pub chaotic: bool,
    /// The terms that the scene has.
    pub terms: Vec<Term>,
    /// All runs that were tried.
    pub trials: Vec<Trial>,
}

impl Setting {
    fn of(options: &Options) -> Setting {
        let &Options { method, quality, levels, tethers, .. } = options;
        Setting { method, quality, levels, tethers, terms: Terms::ALL }
    }

    fn with_substeps(self, count: u32) -> Setting {
        Setting { quality: Quality::Substeps(count), ..self }
    }

    /// These options with the setting applied.
    #[must_use]
    pub fn options(&self, options: &Options) -> Options {
        let &Setting { method, quality, levels, tethers, terms } = self;
        let mut fabric = options.fabric;
        fabric.bending *= f32::from(u8::from(terms.bending));
        fabric.damping *= f32::from(u8::from(terms.damping));
        Options { method, quality, levels, tethers, fabric, ..options.clone() }
    }

    /// These attributes with the setting applied: without air if the setting leaves it out.
    #[must_use]
    pub fn attributes(&self, attributes: Attributes) -> Attributes {
        let air_density = if self.terms.air { attributes.air_density } else { 0.0 };
        Attributes { air_density, ..attributes }
    }
}

/// Formats the setting as fields to paste into [`Options`]. Whether the scene's air can be left out is not among them.
impl Display for Setting {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Setting { method, quality, levels, tethers, terms } = self;
        write!(
            f,
            "method: Method::{method:?}, quality: Quality::{quality:?}, levels: Levels::{levels:?}, tethers: Tethers::{tethers:?}"
        )?;
        match (terms.bending, terms.damping) {
            (true, true) => Ok(()),
            (true, false) => write!(f, ", fabric: Fabric {{ damping: 0.0, ..fabric }}"),
            (false, _) => write!(f, ", fabric: Fabric {{ bending: 0.0, damping: 0.0, ..fabric }}"),
        }
    }
}

/// Finds the cheapest method, number of substeps, coarse levels and terms that keep a tolerance in a scene of `mesh`
/// with `options` over `frames` frames of 1/60 s. `attributes` returns the attributes of each frame, counted from 1;
/// of frame 0, before the first step, only the colliders are used.
///
/// The scene is simulated up to 20 times, for a [`Tolerance::Position`] two of them with the stiffness resolved. These take most of
/// the time: expect about three times that of one resolved run. No run sleeps. Times are measured on this machine under its current load.
///
/// # Errors
/// As [`Deformer::new`](crate::Deformer::new). Also if the tolerance is not a finite number above 0, if there are fewer
/// than two frames, of which the search compares every other one, or if a step of a resolved run fails, with its frame.
pub fn tune(
    mesh: &Mesh,
    options: &Options,
    attributes: impl Fn(u32) -> Attributes,
    frames: u32,
    tolerance: Tolerance,
) -> Result<Tuned, BuildError> {
    let (Tolerance::Position(most) | Tolerance::Strain(most)) = tolerance;
    if !(most > 0.0 && most.is_finite()) {
        return Err(BuildError::value("tolerance", most, "must be finite and above 0"));
    }
    if frames < 2 {
        return Err(BuildError::value("frames", frames, "must be at least 2"));
    }
    check_mesh(mesh)?;
    let edges = mesh.edges();
    let has_edges = has_edges(&edges, mesh.positions.len());
    let is_compared = |(_, has_edges): &(u32, bool)| *has_edges || edges.is_empty();
    let compared = (0..).zip(has_edges).filter(is_compared).map(|(vertex, _)| vertex).collect();
    Search::new(Scene { mesh, options, attributes: &attributes, frames, compared }, f64::from(most)).run(tolerance)
}
