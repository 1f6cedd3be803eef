//! Two seconds of HANG: is the motion right, and how many substeps does that take?

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Gpu, Mesh, Options};

use crate::Failure;
#[allow(unreachable_pub, reason = "the tests' own")]
#[path = "../../tests/common/hang.rs"]
pub(crate) mod scene;

/// A frame (s).
pub(crate) const FRAME: f32 = 1.0 / 60.0;
/// Frames of a run, and of those the ones that are looked at.
const FRAMES: u32 = 120;
const SAMPLE: u32 = 20;
/// How far the centre of mass has dropped after [`SAMPLE`] frames when all is resolved (m), and how near is right.
const DROP: f64 = 0.372;
const DROP_TOLERANCE: f64 = 0.02;
/// Strain that is asked for: the mean over edges, and over the frames looked at.
pub(crate) const STRAIN: f64 = 0.01;
/// How far kinetic and potential energy may stand above the start (J): a thousandth of what the sheet has to lose.
const ENERGY: f64 = 1e-3;

/// What two seconds came to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    /// Mean of the samples' mean strains, and the largest strain of any.
    pub(crate) mean_strain: f64,
    pub(crate) max_strain: f64,
    /// Drop of the centre of mass after 20 frames (m).
    pub(crate) drop: f64,
    /// Highest energy of any sample, above the start's (J): motion and height. What a sweep leaves of stretch is no energy
    /// that it can give back, and is judged as strain.
    pub(crate) energy: f64,
}

impl Run {
    /// Plays HANG on a backend.
    pub(crate) fn new(n: u32, substeps: u32, backend: Backend, gpu: Option<&Gpu>) -> Result<Run, Failure> {
        let mut deformer = sheet(n, substeps, backend, gpu)?;
        let masses = scene::grid_masses(n, 0.2);
        let total: f64 = masses.iter().map(|&mass| f64::from(mass)).sum();
        let mut run = Run { mean_strain: 0.0, max_strain: 0.0, drop: 0.0, energy: f64::NEG_INFINITY };
        for frame in 1..=FRAMES {
            deformer.step(FRAME, &Attributes::default())?;
            if frame % SAMPLE > 0 {
                continue;
            }
            let measure = deformer.measure()?;
            let height = |x: &[Vec3]| x.iter().zip(&masses).map(|(x, &mass)| f64::from(x.y) * f64::from(mass)).sum::<f64>();
            let height = height(deformer.positions()?) / total;
            if frame == SAMPLE {
                run.drop = -height;
            }
            run.mean_strain += f64::from(measure.mean_strain) * f64::from(SAMPLE) / f64::from(FRAMES);
            run.max_strain = run.max_strain.max(f64::from(measure.max_strain));
            run.energy = run.energy.max(measure.kinetic_energy + 9.81 * total * height);
        }
        Ok(run)
    }

    /// Whether the motion is right: the strain asked for, the fall as it should be, no energy gained.
    pub(crate) fn is_right(&self) -> bool {
        self.wrongs().next().is_none()
    }

    /// What is wrong with it, in a word or two.
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

/// HANG at rest.
pub(crate) fn sheet(n: u32, substeps: u32, backend: Backend, gpu: Option<&Gpu>) -> Result<Deformer, Failure> {
    let (mesh, options) = scene::hang(n, substeps, backend);
    make(&mesh, options, gpu)
}

/// A cloth on this program's device.
pub(crate) fn make(mesh: &Mesh, options: Options, gpu: Option<&Gpu>) -> Result<Deformer, Failure> {
    Ok(Deformer::new(mesh, Options { gpu: gpu.cloned(), ..options })?)
}

/// The least substeps with which the motion is right, to a sixteenth, and the run that shows it; `None` if no run of at
/// most `patience` (s) was right.
///
/// Strain falls as the substeps squared where it is the sweep's alone, which makes the first guesses; what is found is
/// what was run.
pub(crate) fn least_substeps(
    n: u32,
    first: u32,
    backend: Backend,
    gpu: Option<&Gpu>,
    patience: f64,
) -> Result<Option<(u32, Run)>, Failure> {
    let (mut wrong, mut right) = (0, None);
    let mut substeps = first;
    loop {
        let begin = std::time::Instant::now();
        let run = Run::new(n, substeps, backend, gpu)?;
        let seconds = begin.elapsed().as_secs_f64();
        eprintln!("  N = {n}, S = {substeps}: strain {:.2e}, drop {:.4} m, {}", run.mean_strain, run.drop, run.verdict());
        if run.is_right() {
            right = Some((substeps, run));
        } else {
            wrong = substeps;
        }
        let guess = f64::from(substeps) * (run.mean_strain / STRAIN).sqrt();
        let next = match right {
            None => (1.05 * guess).clamp(1.15 * f64::from(substeps) + 1.0, 3.0 * f64::from(substeps)),
            Some((least, _)) if least - wrong <= (least / 16).max(1) => return Ok(right),
            Some((least, _)) if wrong == 0 => {
                (1.05 * guess).clamp(f64::from(least) / 3.0, f64::from(least) - 1.0).floor().max(1.0)
            }
            Some((least, _)) => (f64::from(wrong) * f64::from(least)).sqrt().ceil().min(f64::from(least) - 1.0),
        };
        if right.is_none() && seconds * next / f64::from(substeps) > patience {
            return Ok(None);
        }
        substeps = next as u32;
    }
}
