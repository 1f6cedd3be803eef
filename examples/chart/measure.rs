//! Runs every setting and measures its time, error and strain.

use std::fmt::{self, Display};
use std::time::Instant;

use cloth_deformer::glam::{DVec3, Vec3};
use cloth_deformer::{Attributes, Backend, Deformer, Levels, Method, Options, Quality, StepError};

use crate::Failure;
use crate::arguments::{Arguments, BACKENDS};
use crate::scene::{Scene, Truth, rms};

/// Length of a frame (s).
const FRAME: f32 = 1.0 / 60.0;
/// For so long (s) a GPU works before it is timed, because it takes seconds to raise its clock rate again after a pause, in which it
/// is up to four times slower.
const WARM_UP: f64 = 2.0;
/// Most frames of a timed run; all frames cost the same.
const TIMED: u32 = 10;
/// Fewest vertices with which [`Levels::Auto`] uses levels, mostly.
const LEVELS_FROM: usize = 1000;
/// Most substeps to try.
const MOST: u32 = 5120;

/// A setting to try.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Setting {
    pub(crate) method: Method,
    pub(crate) levels: Levels,
    pub(crate) backend: Backend,
    pub(crate) substeps: u32,
}

/// The result of a setting.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    pub(crate) scene: String,
    pub(crate) setting: Setting,
    /// Median time per frame (ms).
    pub(crate) ms: f64,
    /// RMS distance of the vertices from the reference, divided by the extent; infinite if the run became unstable, NaN
    /// without a reference.
    pub(crate) error: f64,
    /// Mean and largest strain of the edges.
    pub(crate) strain: [f64; 2],
}

/// How much is measured.
#[derive(Debug, Clone)]
pub(crate) struct Effort {
    methods: Vec<(Method, Levels)>,
    backends: Vec<Backend>,
    /// Ratio of the substeps of successive settings.
    ratio: f64,
    /// Longest run of a setting (s); a curve ends there.
    longest: f64,
    /// Number of timed runs of each setting, besides the first run.
    rounds: u32,
    /// Time limit of the last reference run (s).
    pub(crate) reference: f64,
}

impl Effort {
    pub(crate) fn new(arguments: &Arguments, backends: Vec<Backend>) -> Effort {
        let relaxation = arguments.iterations.iter().map(|&iterations| (Method::Relaxation { iterations }, Levels::Off));
        let steps = [Levels::Auto, Levels::Off].map(|levels| (Method::SmallSteps, levels));
        let methods = steps.into_iter().chain(relaxation).chain([(Method::Springs, Levels::Off)]).collect();
        let (ratio, longest, rounds, reference) =
            if arguments.quick { (2.0, 2.0, 3, 8.0) } else { (std::f64::consts::SQRT_2, 6.0, 5, 60.0) };
        Effort { methods, backends, ratio, longest, rounds, reference }
    }

    /// Every method on every backend; small steps also without levels, if the mesh is large enough to have them.
    fn curves(&self, vertices: usize) -> impl Iterator<Item = (Method, Levels, Backend)> {
        let all =
            self.backends.iter().flat_map(|&backend| self.methods.iter().map(move |&(method, levels)| (method, levels, backend)));
        all.filter(move |&(method, levels, _)| method != Method::SmallSteps || levels == Levels::Auto || vertices >= LEVELS_FROM)
    }
}

/// A setting being measured.
struct Trial {
    row: Row,
    deformer: Deformer,
    /// Time per frame in each run (ms).
    times: Vec<f64>,
}

/// Error, strain and time of every setting of `scene`. A curve ends where the error is below that of the reference,
/// where more substeps no longer help, or where a run takes too long.
pub(crate) fn errors(scene: &Scene, truth: &Truth, effort: &Effort) -> Result<Vec<Row>, Failure> {
    let mut trials = Vec::new();
    for (method, levels, backend) in effort.curves(scene.mesh.positions.len()) {
        // The plug-in of 2013 took one step per frame.
        let (mut count, mut last): (f64, f64) =
            (if matches!(method, Method::Relaxation { .. }) { 1.0 } else { 5.0 }, f64::INFINITY);
        loop {
            let substeps = count.round() as u32;
            let (trial, seconds) = Trial::first(scene, Setting { method, levels, backend, substeps }, truth.frames, Some(truth))?;
            let error = trial.row.error;
            trials.push(trial);
            let settled = error < truth.change || (error < 3e-3 && error > 0.85 * last);
            count *= effort.ratio;
            if settled || seconds * effort.ratio > effort.longest || count > f64::from(MOST) {
                break;
            }
            last = error;
        }
    }
    // The settings of a backend take turns, so that other load on this machine affects all of them alike.
    let frames = truth.frames.min(TIMED);
    for &backend in &effort.backends {
        let runs = |trial: &&mut Trial| trial.row.setting.backend == backend && trial.row.error.is_finite();
        let mut runs: Vec<&mut Trial> = trials.iter_mut().filter(runs).collect();
        if let Some(trial) = runs.first_mut() {
            trial.warm_up(frames)?;
        }
        for _ in 0..effort.rounds {
            runs.iter_mut().try_for_each(|trial| trial.time(frames).map(|_| ()))?;
        }
    }
    Ok(trials.into_iter().map(Trial::finished).collect())
}

/// Strain after two seconds for every method and backend, with as many substeps as fit into `budget` (ms) per frame.
pub(crate) fn strain(scene: &Scene, budget: f64, effort: &Effort) -> Result<Vec<Row>, Failure> {
    const FRAMES: u32 = 120;
    let mut rows = Vec::new();
    for (method, levels, backend) in effort.curves(scene.mesh.positions.len()) {
        let Some(substeps) = affordable(scene, Setting { method, levels, backend, substeps: 1 }, budget)? else {
            eprintln!("{}: left out, more than {budget} ms: {}", scene.title, Setting { method, levels, backend, substeps: 1 });
            continue;
        };
        let (mut trial, _) = Trial::first(scene, Setting { method, levels, backend, substeps }, FRAMES, None)?;
        if trial.row.strain[0].is_finite() {
            for _ in 0..effort.rounds {
                trial.time(TIMED)?;
            }
        }
        rows.push(trial.finished());
    }
    Ok(rows)
}

/// The number of substeps that take `budget` (ms) per frame: it is doubled until they take longer, and then found to
/// within a tenth by bisection.
///
/// The time is not assumed to be proportional: a dispatch has a fixed cost, and where levels switch off, twice the
/// substeps may take less time.
fn affordable(scene: &Scene, setting: Setting, budget: f64) -> Result<Option<u32>, Failure> {
    Trial::first(scene, setting, 3, None)?.0.warm_up(5)?;
    let fits = |substeps| -> Result<bool, Failure> {
        let (mut probe, _) = Trial::first(scene, Setting { substeps, ..setting }, 3, None)?;
        for _ in 0..4 {
            probe.time(5)?;
        }
        Ok(probe.times[1..].iter().copied().fold(f64::INFINITY, f64::min) <= budget)
    };
    let (mut enough, mut many) = (0, 1);
    while many <= MOST && fits(many)? {
        (enough, many) = (many, 2 * many);
    }
    while many - enough > 1 + enough / 10 {
        let middle = enough.midpoint(many);
        if fits(middle)? { enough = middle } else { many = middle }
    }
    Ok((enough > 0).then(|| enough.min(MOST)))
}

impl Trial {
    /// Makes the first run, which gives error and strain, and returns its duration (s). It also warms up, so its time
    /// counts only if no other run follows.
    fn first(scene: &Scene, setting: Setting, frames: u32, truth: Option<&Truth>) -> Result<(Trial, f64), Failure> {
        let options = Options {
            backend: setting.backend,
            method: setting.method,
            levels: setting.levels,
            quality: Quality::Substeps(setting.substeps),
            ..scene.options.clone()
        };
        let deformer = Deformer::new(&scene.mesh, options).map_err(|error| Failure::from(&error))?;
        let row = Row {
            scene: scene.name.clone(),
            setting,
            ms: f64::NAN,
            error: truth.map_or(f64::NAN, |_| f64::INFINITY),
            strain: [f64::INFINITY; 2],
        };
        let mut trial = Trial { row, deformer, times: Vec::new() };
        let start = Instant::now();
        let stable = trial.time(frames)?;
        let seconds = start.elapsed().as_secs_f64();
        if stable {
            let positions = trial.deformer.positions().map_err(|error| Failure::from(&error))?;
            let positions: Vec<DVec3> = positions.iter().copied().map(Vec3::as_dvec3).collect();
            let measure = trial.deformer.measure().map_err(|error| Failure::from(&error))?;
            let strain = [measure.mean_strain, measure.max_strain].map(f64::from);
            // Beyond its limit a method may take a while to overflow. A cloth stretched to twice its length counts as
            // unstable.
            let error = truth.map_or(0.0, |truth| rms(&positions, &truth.positions) / scene.extent);
            if error < 1.0 && strain[0] < 1.0 {
                trial.row.strain = strain;
                trial.row.error = truth.map_or(f64::NAN, |_| error);
            }
        }
        Ok((trial, seconds))
    }

    /// Runs until a GPU is at its full clock rate.
    fn warm_up(&mut self, frames: u32) -> Result<(), Failure> {
        let begin = Instant::now();
        while self.row.setting.backend != Backend::Cpu && begin.elapsed().as_secs_f64() < WARM_UP {
            self.time(frames)?;
            self.times.pop();
        }
        Ok(())
    }

    /// Makes another timed run from rest: all steps, and waiting for their result. Returns whether it stayed finite.
    fn time(&mut self, frames: u32) -> Result<bool, Failure> {
        let attributes = Attributes::default();
        self.deformer.reset();
        let start = Instant::now();
        let mut steps = 0;
        let run = (0..frames).try_for_each(|_| {
            steps += 1;
            self.deformer.step(FRAME, &attributes).map(|_| ())
        });
        let run = run.and_then(|()| self.deformer.positions().map(|_| ()));
        self.times.push(start.elapsed().as_secs_f64() * 1e3 / f64::from(steps));
        match run {
            Ok(()) => Ok(true),
            Err(StepError::Unstable { .. }) => Ok(false),
            Err(error) => Err(Failure::from(&error)),
        }
    }

    fn finished(mut self) -> Row {
        let warm = if self.times.len() > 1 { &mut self.times[1..] } else { &mut self.times[..] };
        warm.sort_by(f64::total_cmp);
        // An unstable run may end early, so its time means nothing.
        self.row.ms = if self.row.strain[0].is_finite() { warm[warm.len() / 2] } else { f64::NAN };
        self.row
    }
}

impl Row {
    /// Whether the run stayed stable.
    pub(crate) fn is_stable(&self) -> bool {
        self.strain[0].is_finite()
    }
}

/// The Pareto front: the settings that no other setting beats in both time and error, by increasing time, among those
/// whose error is above that of the reference.
pub(crate) fn pareto<'a>(rows: &'a [Row], truth: &Truth) -> Vec<&'a Row> {
    let mut front: Vec<&Row> = rows.iter().filter(|row| row.error.is_finite() && row.error > truth.change).collect();
    front.sort_by(|a, b| a.ms.total_cmp(&b.ms).then(a.error.total_cmp(&b.error)));
    let mut best = f64::INFINITY;
    front.retain(|row| {
        let better = row.error < best;
        best = best.min(row.error);
        better
    });
    front
}

/// For each decade of error that is reached: the decade and the cheapest setting within it.
pub(crate) fn cheapest<'a>(front: &[&'a Row]) -> Vec<(i32, &'a Row)> {
    let decades = (1..=9).map_while(|decade| {
        let row = front.iter().find(|row| row.error <= 10_f64.powi(-decade))?;
        Some((-decade, *row))
    });
    decades.collect()
}

impl Setting {
    pub(crate) fn method(&self) -> &'static str {
        match self.method {
            Method::SmallSteps if self.levels == Levels::Off => "small-steps-no-levels",
            Method::SmallSteps => "small-steps",
            Method::Relaxation { .. } => "relaxation",
            Method::Springs => "springs",
            _ => "other",
        }
    }

    /// Sweeps per substep.
    pub(crate) fn iterations(&self) -> u32 {
        match self.method {
            Method::Relaxation { iterations } => iterations,
            Method::Springs => 0,
            _ => 1,
        }
    }

    pub(crate) fn backend(&self) -> &'static str {
        let named = BACKENDS.iter().find(|(_, backend)| *backend == self.backend);
        named.map_or("auto", |(name, _)| name)
    }
}

/// Formats the setting as arguments of `drape`.
impl Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let method = match self.method {
            Method::SmallSteps if self.levels == Levels::Off => "small-steps --levels off",
            _ => self.method(),
        };
        write!(f, "--method {method}")?;
        if let Method::Relaxation { iterations } = self.method {
            write!(f, " --iterations {iterations}")?;
        }
        write!(f, " --substeps {} --backend {}", self.substeps, self.backend())
    }
}
