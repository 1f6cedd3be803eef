//! Compares `rapier-cloth-core` 0.3.0 with cloth-deformer at the fewest substeps that stretch no more, for HANG.
//!
//! HANG is a square of 1 m with 0.2 kg/m2, released from the horizontal and hung by an edge; here both cloths are
//! inextensible. The peer uses its long-range tethers, no damping, and a bending stiffness too weak to matter. It
//! cannot switch bending off, so the last column has cloth-deformer with bending. Strain is `max(0, l/l0 - 1)`,
//! averaged over edges and over the frames 20, 40, .. 120.

use cloth_deformer::glam;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Mesh, Options, Quality};
use rapier_cloth_core::{Cloth, ClothMaterial, ClothMesh, Solver, SolverSettings, Vec3};

use crate::{FRAME, Failure, Sheet, seconds};

/// Frames of a run, and interval of the samples.
const FRAMES: usize = 120;
const SAMPLE: usize = 20;
/// Number of timed frames, alternating between the two.
const TIMED: usize = 24;
/// Substeps per frame of the peer, and iterations in each. With a single iteration it becomes unstable.
const SETTINGS: [(u32, usize); 3] = [(4, 8), (10, 4), (20, 4)];
/// Numbers of substeps that cloth-deformer may take to match it.
const SUBSTEPS: [u32; 14] = [3, 4, 6, 8, 11, 15, 20, 28, 40, 56, 80, 112, 160, 224];

/// Results of two seconds.
#[derive(Debug, Clone, Copy)]
struct Run {
    /// Median time per frame (ms).
    frame: f64,
    strain: f64,
    /// Depth of the center after 20 frames (m): 0.372 in a resolved run.
    drop: f64,
}

pub(crate) fn run(sizes: &[u32]) -> Result<(), Failure> {
    println!(
        "| N | rapier-cloth-core S x it | strain | drop | ms | cloth-deformer S | strain | drop | ms | times faster | with bending, ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    sizes.iter().try_for_each(|&n| compare(n))
}

fn compare(n: u32) -> Result<(), Failure> {
    for (substeps, iterations) in SETTINGS {
        let setting = format!("| {n} | {substeps} x {iterations} |");
        // The peer's strain determines the substeps that it is compared with.
        let Ok(alone) = play(n, FRAMES, &mut [&mut Peer::new(n, substeps, iterations)?]).map(|runs| runs[0]) else {
            println!("{setting} fails | | | | | | | | |");
            continue;
        };
        let matched = SUBSTEPS.iter().find_map(|&substeps| {
            let run = Ours::new(n, substeps, 0.0).and_then(|mut ours| play(n, FRAMES, &mut [&mut ours]));
            run.ok().filter(|runs| runs[0].strain <= alone.strain).map(|runs| (substeps, runs[0]))
        });
        let setting = format!("{setting} {:.1e} | {:.3} |", alone.strain, alone.drop);
        let Some((ours, own)) = matched else {
            println!("{setting} {:.2} | none | | | | | |", alone.frame);
            continue;
        };
        let mut peer = Peer::new(n, substeps, iterations)?;
        let (mut plain, mut bending) = (Ours::new(n, ours, 0.0)?, Ours::new(n, ours, 1e-4)?);
        let times = play(n, TIMED, &mut [&mut peer, &mut plain, &mut bending])?;
        let [peer, plain, bending] = [0, 1, 2].map(|k| times[k].frame);
        println!(
            "{setting} {peer:.2} | {ours} | {:.1e} | {:.3} | {plain:.2} | {:.1} | {bending:.2} |",
            own.strain,
            own.drop,
            peer / plain
        );
    }
    Ok(())
}

/// Runs some frames of each sheet, alternating frame by frame.
fn play(n: u32, frames: usize, sheets: &mut [&mut dyn Sheet]) -> Result<Vec<Run>, Failure> {
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let edges = mesh.edges();
    let strain = |x: &[glam::Vec3]| {
        let stretch = |&[a, b]: &[u32; 2]| {
            let length = |x: &[glam::Vec3]| x[a as usize].as_dvec3().distance(x[b as usize].as_dvec3());
            (length(x) / length(&mesh.positions) - 1.0).max(0.0)
        };
        edges.iter().map(stretch).sum::<f64>() / edges.len() as f64
    };
    let mut runs = vec![Run { frame: 0.0, strain: 0.0, drop: 0.0 }; sheets.len()];
    let mut times = vec![Vec::new(); sheets.len()];
    for frame in 1..=frames {
        for ((sheet, run), times) in sheets.iter_mut().zip(&mut runs).zip(&mut times) {
            let begin = seconds();
            sheet.step()?;
            times.push(1e3 * (seconds() - begin));
            if frame % SAMPLE == 0 {
                let x = sheet.positions()?;
                run.strain += strain(&x) * SAMPLE as f64 / frames as f64;
                if frame == SAMPLE {
                    run.drop = center(n, &x);
                }
                if run.strain.is_nan() || run.strain > 1.0 {
                    return Err("exploded".into());
                }
            }
        }
    }
    for (run, times) in runs.iter_mut().zip(&mut times) {
        times.sort_by(f64::total_cmp);
        run.frame = times[times.len() / 2];
    }
    Ok(runs)
}

/// Depth of the center of the square (m), by the trapezoidal rule along both sides.
fn center(n: u32, x: &[glam::Vec3]) -> f64 {
    let half = |k: u32| if k == 0 || k == n - 1 { 0.5 } else { 1.0 };
    let cells = f64::from((n - 1) * (n - 1));
    (0..n * n).map(|v| -f64::from(x[v as usize].y) * half(v / n) * half(v % n)).sum::<f64>() / cells
}

struct Ours(Deformer);

impl Ours {
    fn new(n: u32, substeps: u32, bending: f32) -> Result<Ours, Failure> {
        let options = Options {
            backend: Backend::Cpu,
            quality: Quality::Substeps(substeps),
            fabric: Fabric { density: 0.2, stretch: f32::INFINITY, bending, damping: 0.0 },
            pinned: (0..n).collect(),
            ..Options::default()
        };
        Ok(Ours(Deformer::new(&Mesh::grid(n, n, 1.0, 1.0), options)?))
    }
}

impl Sheet for Ours {
    fn step(&mut self) -> Result<(), Failure> {
        self.0.step(FRAME, &Attributes::default())?;
        Ok(())
    }

    fn positions(&mut self) -> Result<Vec<glam::Vec3>, Failure> {
        Ok(self.0.positions()?.to_vec())
    }
}

struct Peer {
    cloth: Cloth,
    solver: Solver,
    settings: SolverSettings,
    substeps: u32,
}

impl Peer {
    fn new(n: u32, substeps: u32, iterations: usize) -> Result<Peer, Failure> {
        let mesh = Mesh::grid(n, n, 1.0, 1.0);
        let positions = mesh.positions.iter().map(|x| Vec3::from_array(x.to_array())).collect();
        let material = ClothMaterial { surface_density: 0.2, bend_compliance: 1e6, damping: 0.0, ..ClothMaterial::default() };
        let mut cloth = Cloth::new(ClothMesh::new(positions, mesh.triangles)?, material)?;
        for vertex in 0..n {
            cloth.pin(vertex, cloth.positions()[vertex as usize])?;
        }
        Ok(Peer { cloth, solver: Solver::new(), settings: SolverSettings { iterations, ..SolverSettings::default() }, substeps })
    }
}

impl Sheet for Peer {
    fn step(&mut self) -> Result<(), Failure> {
        for _ in 0..self.substeps {
            self.solver.step(&mut self.cloth, FRAME / self.substeps as f32, Vec3::Y * -9.81, &self.settings)?;
        }
        Ok(())
    }

    fn positions(&mut self) -> Result<Vec<glam::Vec3>, Failure> {
        Ok(self.cloth.positions().iter().map(|x| glam::Vec3::from_array(x.to_array())).collect())
    }
}
