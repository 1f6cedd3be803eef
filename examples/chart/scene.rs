//! The scenes: a cloth, its pins, and its reference positions.

use std::path::Path;
use std::time::Instant;

use cloth_deformer::glam::DVec3;
use cloth_deformer::{Backend, Deformer, Mesh, Options, UpAxis};

use crate::Failure;
use crate::arguments::Arguments;
use crate::hang::hang;
use crate::pins::bounds;
use crate::reference::Reference;

/// The reference has converged if halving its step changes it by less than this, in extents: a tenth of the error of
/// single precision.
const CONVERGED: f64 = 2e-6;
/// First number of steps per frame of the reference; it is doubled from there. With too few steps the run becomes
/// unstable, which is detected.
const FIRST_STEPS: u32 = 64;

/// Largest number of steps per frame of the reference.
const MAX_STEPS: u32 = 1 << 16;

/// A hanging cloth.
pub(crate) struct Scene {
    /// Name for files.
    pub(crate) name: String,
    /// Name for titles.
    pub(crate) title: String,
    pub(crate) mesh: Mesh,
    /// All options but method, backend and quality.
    pub(crate) options: Options,
    /// The largest side of the mesh's bounding box (m).
    pub(crate) extent: f64,
    /// Frames at which positions may be compared, ascending. The last one at which the motion is still predictable is
    /// used.
    horizons: Vec<u32>,
}

/// The reference positions.
pub(crate) struct Truth {
    /// The frame they belong to.
    pub(crate) frames: u32,
    pub(crate) positions: Vec<DVec3>,
    /// Change when the reference's step was last halved: RMS over the vertices, in extents.
    pub(crate) change: f64,
    /// Steps per frame of the reference.
    pub(crate) steps: u32,
    /// Whether the motion is predictable until then, that is, halving the step converges as it should.
    pub(crate) predictable: bool,
}

impl Scene {
    /// HANG: a sheet of 1 m x 1 m with n x n vertices, horizontal at rest, let go with one side pinned.
    pub(crate) fn hang(n: u32) -> Scene {
        let (mesh, options) = hang(n, 1, Backend::Cpu);
        let title = format!("HANG, {n} x {n} vertices");
        Scene { name: format!("hang{n}"), title, mesh, options, extent: 1.0, horizons: vec![30] }
    }

    /// The user's mesh, pinned as the arguments say.
    pub(crate) fn load(path: &Path, arguments: &Arguments) -> Result<Scene, Failure> {
        let mesh = Mesh::load_obj(path).map_err(Failure::input)?;
        let (low, high) = bounds(&mesh);
        let extent = f64::from((high - low).max_element());
        let pinned = arguments.pin.vertices(&mesh, UpAxis::Y);
        let options = Options { fabric: arguments.membrane(), pinned, ..Options::default() };
        // Building the cloth reports what is wrong with the mesh or the pins.
        Deformer::new(&mesh, Options { backend: Backend::Cpu, ..options.clone() })
            .map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))?;
        // A vertex without a triangle has a small mass, so that it can fall.
        let mass = |area: &f64| (f64::from(options.fabric.density) * area).max(1e-6) as f32;
        let mass = Some(mesh.vertex_areas().iter().map(mass).collect());
        let options = Options { mass, ..options };
        let stem = path.file_stem().map_or("mesh".into(), |stem| stem.to_string_lossy());
        // Times for one meter of cloth; the period of a swing is proportional to sqrt(extent).
        let frames = |seconds: f64| (60.0 * seconds * extent.sqrt()).round().clamp(1.0, 600.0) as u32;
        Ok(Scene {
            name: stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect(),
            title: format!("{stem}, {} vertices", mesh.positions.len()),
            mesh,
            options,
            extent,
            horizons: [0.05, 0.1, 0.25, 0.5].map(frames).to_vec(),
        })
    }

    /// Runs the double-precision reference, halving its step until that no longer matters or `budget` (s) is spent.
    /// Then selects the latest horizon at which the motion is still predictable: where halving does not matter, or at
    /// least divides the change by about four, as it does for a second-order method until chaos sets in.
    pub(crate) fn truth(&self, budget: f64) -> Result<Truth, Failure> {
        let masses = self.options.mass.as_deref().expect("both kinds of scene set it");
        // The state at each horizon, as far as the run stays finite.
        let run = |steps: u32| {
            let stretch = f64::from(self.options.fabric.stretch);
            let mut cloth = Reference::new(&self.mesh, masses, &self.options.pinned, stretch);
            let mut states: Vec<Vec<DVec3>> = Vec::new();
            for frame in 1..=self.horizons.last().copied().unwrap_or(0) {
                cloth = cloth.run(1.0 / 60.0, steps);
                if !cloth.x.iter().all(|x| x.is_finite()) {
                    break;
                }
                states.extend(self.horizons.iter().filter(|&&horizon| horizon == frame).map(|_| cloth.x.clone()));
            }
            states
        };
        let mut steps = FIRST_STEPS;
        let mut states = run(steps);
        let mut before = vec![f64::INFINITY; self.horizons.len()];
        loop {
            let start = Instant::now();
            steps *= 2;
            let finer = run(steps);
            let change = |index: usize| match (states.get(index), finer.get(index)) {
                (Some(a), Some(b)) => rms(a, b) / self.extent,
                _ => f64::INFINITY,
            };
            let changes: Vec<f64> = (0..self.horizons.len()).map(change).collect();
            let last = changes.iter().copied().fold(0.0, f64::max);
            // Twice the steps take twice the time. A run that becomes unstable ends early and costs little.
            let spent = 2.0 * start.elapsed().as_secs_f64() > budget && last.is_finite();
            if last > CONVERGED && !spent && steps < MAX_STEPS {
                (states, before) = (finer, changes);
                continue;
            }
            let predictable = |&index: &usize| {
                changes[index] <= CONVERGED || (changes[index] < 1e-4 && (3.0..6.0).contains(&(before[index] / changes[index])))
            };
            let latest = (0..changes.len()).rev().find(predictable);
            let index = latest.unwrap_or(0);
            if changes[index].is_infinite() {
                let message = "the reference run explodes even at the smallest step; look for slivers or doubled vertices";
                return Err(Failure::input(format_args!("{}: {message}", self.title)));
            }
            let positions = finer.into_iter().nth(index).expect("as many states as horizons");
            return Ok(Truth {
                frames: self.horizons[index],
                positions,
                change: changes[index],
                steps,
                predictable: latest.is_some(),
            });
        }
    }
}

/// Root mean square distance (m) over the vertices.
pub(crate) fn rms(a: &[DVec3], b: &[DVec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}
