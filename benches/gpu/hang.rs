//! Two seconds of HANG: whether the motion is right, and how many substeps that takes.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Gpu, Levels, Mesh, Options};

use crate::Failure;
#[allow(unreachable_pub, reason = "the tests' own")]
#[path = "../../tests/common/hang.rs"]
pub(crate) mod scene;

/// Duration of a frame (s).
pub(crate) const FRAME: f32 = 1.0 / 60.0;
/// Number of frames of a run, and interval of those that are sampled.
const FRAMES: u32 = 120;
const SAMPLE: u32 = 20;
/// How far the center of mass has dropped after [`SAMPLE`] frames in a resolved run (m), and the tolerance.
const DROP: f64 = 0.372;
const DROP_TOLERANCE: f64 = 0.02;
/// The mean strain allowed, over edges and sampled frames.
pub(crate) const STRAIN: f64 = 0.01;
/// By how much kinetic and potential energy may exceed the start (J): a thousandth of what the sheet can release.
const ENERGY: f64 = 1e-3;

/// The result of two seconds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    /// Mean of the samples' mean strains.
    pub(crate) mean_strain: f64,
    /// The largest strain of any sample.
    pub(crate) max_strain: f64,
    /// Drop of the center of mass after 20 frames (m).
    pub(crate) drop: f64,
    /// Highest energy of any sample relative to the start (J), kinetic and potential in gravity. The stretch that a
    /// sweep leaves is not energy that it can return, and is judged as strain.
    pub(crate) energy: f64,
    /// Number of coarse levels used.
    pub(crate) levels: u32,
}

impl Run {
    /// Runs HANG from its start.
    fn of(cloth: &mut Deformer, n: u32) -> Result<Run, Failure> {
        let masses = scene::grid_masses(n, 0.2);
        let total: f64 = masses.iter().map(|&mass| f64::from(mass)).sum();
        let mut run = Run { mean_strain: 0.0, max_strain: 0.0, drop: 0.0, energy: f64::NEG_INFINITY, levels: 0 };
        for frame in 1..=FRAMES {
            run.levels = cloth.step(FRAME, &Attributes::default())?.levels;
            if frame % SAMPLE > 0 {
                continue;
            }
            let measure = cloth.measure()?;
            let height = |x: &[Vec3]| x.iter().zip(&masses).map(|(x, &mass)| f64::from(x.y) * f64::from(mass)).sum::<f64>();
            let height = height(cloth.positions()?) / total;
            if frame == SAMPLE {
                run.drop = -height;
            }
            run.mean_strain += f64::from(measure.mean_strain) * f64::from(SAMPLE) / f64::from(FRAMES);
            run.max_strain = run.max_strain.max(f64::from(measure.max_strain));
            run.energy = run.energy.max(measure.kinetic_energy + 9.81 * total * height);
        }
        Ok(run)
    }

    /// Whether the motion is right: strain within the limit, the right fall, and no energy gained.
    pub(crate) fn is_right(&self) -> bool {
        self.wrongs().next().is_none()
    }

    /// What is wrong with the motion, in a word or two.
    pub(crate) fn verdict(&self) -> String {
        if self.is_right() { "right".to_owned() } else { self.wrongs().collect::<Vec<_>>().join(", ") }
    }

    fn wrongs(&self) -> impl Iterator<Item = &'static str> {
        let falls_right = (self.drop / DROP - 1.0).abs() <= DROP_TOLERANCE;
        let held =
            [(self.mean_strain <= STRAIN, "stretched"), (falls_right, "falls wrong"), (self.energy <= ENERGY, "gains energy")];
        held.into_iter().filter(|(holds, _)| !holds).map(|(_, wrong)| wrong)
    }
}

/// HANG in its initial state.
pub(crate) fn sheet(n: u32, substeps: u32, backend: Backend, gpu: Option<&Gpu>) -> Result<Deformer, Failure> {
    let (mesh, options) = scene::hang(n, substeps, backend);
    make(&mesh, options, gpu)
}

/// A cloth on this program's device.
pub(crate) fn make(mesh: &Mesh, options: Options, gpu: Option<&Gpu>) -> Result<Deformer, Failure> {
    Ok(Deformer::new(mesh, Options { gpu: gpu.cloned(), ..options })?)
}

/// A sheet that was played for two seconds, and its result.
#[derive(Debug)]
pub(crate) struct Trial {
    pub(crate) substeps: u32,
    pub(crate) run: Run,
    pub(crate) cloth: Deformer,
}

impl Trial {
    fn new(n: u32, substeps: u32, backend: Backend, levels: Levels, gpu: Option<&Gpu>) -> Result<Trial, Failure> {
        let (mesh, options) = scene::hang(n, substeps, backend);
        let mut cloth = make(&mesh, Options { levels, ..options }, gpu)?;
        let run = Run::of(&mut cloth, n)?;
        eprintln!("  N = {n}, S = {substeps}: strain {:.2e}, drop {:.4} m, {}", run.mean_strain, run.drop, run.verdict());
        Ok(Trial { substeps, run, cloth })
    }
}

/// 20 substeps, and unless those are it, the least number with which the motion is right, to within a sixteenth, unless
/// a run would take longer than `patience` (s).
///
/// The strain falls as the square of the substeps where it is that of the sweep alone. That law makes the guesses; what
/// is returned was actually run.
pub(crate) fn trials(n: u32, backend: Backend, levels: Levels, gpu: Option<&Gpu>, patience: f64) -> Result<Vec<Trial>, Failure> {
    let begin = std::time::Instant::now();
    let fixed = Trial::new(n, 20, backend, levels, gpu)?;
    let seconds = begin.elapsed().as_secs_f64() / 20.0;
    let guess = |trial: &Trial| f64::from(trial.substeps) * (trial.run.mean_strain / STRAIN).sqrt();
    let (mut wrong, mut right) = if fixed.run.is_right() { (0, 20) } else { (20, u32::MAX) };
    let mut next = guess(&fixed);
    let mut least = None;
    while right > wrong + (right / 16).max(1) {
        let (low, high) = (f64::from(wrong), f64::from(right));
        let substeps = match (wrong, right) {
            (_, u32::MAX) => (1.05 * next).clamp(1.15 * low + 1.0, 3.0 * low) as u32,
            (0, _) => (1.05 * next).clamp(high / 3.0, high - 1.0).max(1.0) as u32,
            _ => (low * high).sqrt().ceil().min(high - 1.0) as u32,
        };
        if right == u32::MAX && seconds * f64::from(substeps) > patience {
            break;
        }
        let trial = Trial::new(n, substeps, backend, levels, gpu)?;
        next = guess(&trial);
        if trial.run.is_right() {
            right = substeps;
            least = Some(trial);
        } else {
            wrong = substeps;
        }
    }
    Ok([Some(fixed), least].into_iter().flatten().collect())
}
