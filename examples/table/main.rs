//! Checks the backends against each other on this machine, then times them: a table in Markdown, to be kept beside the
//! charts it feeds (`benches/results`).
//!
//! `cargo run --release --example table -- [--quick] [--mesh square2K.obj] [--commit ID] [--date DATE]`

use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Mesh, Options, Quality};

#[allow(unreachable_pub, reason = "the tests' own")]
#[path = "../../tests/common/hang.rs"]
mod hang;
#[allow(dead_code, unreachable_pub, reason = "the tests' own")]
#[path = "../../tests/common/reference.rs"]
mod reference;

/// A frame (s).
const FRAME: f32 = 1.0 / 60.0;

/// Checks and times the backends of this machine.
#[derive(Debug, Parser)]
struct Arguments {
    /// Small sizes only.
    #[arg(long)]
    quick: bool,
    /// A mesh for the check of the backends against each other, as well as the grid.
    #[arg(long)]
    mesh: Option<std::path::PathBuf>,
    /// Printed above the table.
    #[arg(long, default_value = "unknown")]
    commit: String,
    /// Printed above the table.
    #[arg(long, default_value = "undated")]
    date: String,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("table: {error}");
            ExitCode::from(2)
        }
    }
}

type Failure = Box<dyn std::error::Error>;

fn run(arguments: &Arguments) -> Result<bool, Failure> {
    let backends = available();
    let adapter = backends.iter().find_map(|(_, adapter)| adapter.clone()).unwrap_or_else(|| "no GPU".to_owned());
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    println!("{}, commit {}, adapter {adapter}, {cores} CPU threads\n", arguments.date, arguments.commit);
    let backends: Vec<Backend> = backends.into_iter().map(|(backend, _)| backend).collect();

    let mut good = true;
    println!("| check | backend | figure | bound | |\n|---|---|---|---|---|");
    let mut check = |name: &str, backend: Backend, figure: f64, bound: f64| {
        let holds = figure <= bound;
        good &= holds;
        println!("| {name} | {backend:?} | {figure:.2e} | {bound:.1e} | {} |", if holds { "ok" } else { "**FAILS**" });
    };
    let grid = Mesh::grid(41, 41, 1.0, 1.0);
    let meshes = [Some(("grid 41", grid)), arguments.mesh.as_ref().map(Mesh::load_obj).transpose()?.map(|mesh| ("mesh", mesh))];
    for (name, mesh) in meshes.iter().flatten() {
        let (cpu, moved) = blown(mesh, Backend::Cpu, 0.0)?;
        // What the scene makes of a rounding: no two machines can agree better.
        let rounded = rms(&cpu, &blown(mesh, Backend::Cpu, 3e-8)?.0) / moved;
        check(&format!("{name}: start moved by 3e-8 m, over {moved:.2} m moved"), Backend::Cpu, rounded, 2e-3);
        for &backend in backends.iter().filter(|&&backend| backend != Backend::Cpu) {
            let (other, _) = blown(mesh, backend, 0.0)?;
            check(&format!("{name}: apart from the CPU, over {moved:.2} m moved"), backend, rms(&cpu, &other) / moved, 2e-3);
        }
        for &backend in &backends {
            let again = blown(mesh, backend, 0.0)?.0 == blown(mesh, backend, 0.0)?.0;
            check(&format!("{name}: replays bit for bit"), backend, if again { 0.0 } else { 1.0 }, 0.0);
        }
    }

    // Position error at 0.5 s against the f64 reference, its step halved once for N = 32.
    for (n, substeps, bound) in [(32, 80, 0.9e-4), (64, 160, 1.5e-4), (128, 320, 2.4e-4)] {
        if arguments.quick && n > 32 {
            continue;
        }
        let (mesh, options) = hang::hang(n, substeps, Backend::Cpu);
        let masses = hang::grid_masses(n, 0.2);
        let truth = reference::Reference::new(&mesh, &masses, &options.pinned, 5000.0).run(0.5, 60 * substeps).positions();
        for &backend in backends.iter().filter(|&&backend| backend != Backend::Hybrid || n < 128) {
            let mut deformer = Deformer::new(&mesh, Options { backend, ..options.clone() })?;
            for _ in 0..30 {
                deformer.step(FRAME, &Attributes::default())?;
            }
            check(&format!("HANG N = {n}, S = {substeps}: position error"), backend, rms(deformer.positions()?, &truth), bound);
        }
    }

    let sizes: &[u32] = if arguments.quick { &[16, 32, 64] } else { &[16, 32, 64, 96, 128, 256, 512, 1024] };
    println!(
        "\nHANG, S = 20 and the substeps of Strain(0.03): ms a frame, submit to positions known on the device (median of frames)\n"
    );
    println!("| N | S | {} |", backends.iter().map(|b| format!("{b:?}")).collect::<Vec<_>>().join(" | "));
    println!("|---|---|{}", "---|".repeat(backends.len()));
    for &n in sizes {
        for quality in [Quality::Substeps(20), Quality::default()] {
            if n > 256 && quality == Quality::default() {
                continue;
            }
            let mut cells = Vec::new();
            let mut substeps = 0;
            for &backend in &backends {
                let (ms, count) = time(n, quality, backend)?;
                substeps = count;
                cells.push(format!("{ms:.3}"));
            }
            println!("| {n} | {substeps} | {} |", cells.join(" | "));
        }
    }
    Ok(good)
}

/// The backends of this machine and the adapters behind them.
fn available() -> Vec<(Backend, Option<String>)> {
    let mesh = Mesh::grid(2, 2, 1.0, 1.0);
    let try_backend = |backend| {
        let deformer = Deformer::new(&mesh, Options { backend, ..Options::default() }).ok()?;
        Some((backend, deformer.adapter().map(str::to_owned)))
    };
    [Backend::Cpu, Backend::Hybrid, Backend::Gpu].into_iter().filter_map(try_backend).collect()
}

/// 16 frames of a towel on three pins in the wind, its start moved by at most `rounding` (m): its positions, and how far
/// it moved (RMS) (m).
fn blown(mesh: &Mesh, backend: Backend, rounding: f32) -> Result<(Vec<Vec3>, f64), Failure> {
    let last = mesh.positions.len() as u32 - 1;
    let pinned = vec![0, last / 2, last];
    let options = Options { backend, fabric: Fabric::TOWEL, quality: Quality::Substeps(20), pinned, ..Options::default() };
    let mut deformer = Deformer::new(mesh, options)?;
    if rounding > 0.0 {
        let wave = |k: usize| Vec3::new((k as f32).sin(), (1.3 * k as f32).sin(), (1.7 * k as f32).sin());
        let moved: Vec<Vec3> = mesh.positions.iter().enumerate().map(|(k, x)| *x + rounding * wave(k)).collect();
        deformer.set_state(&moved, &vec![Vec3::ZERO; moved.len()])?;
    }
    let attributes = Attributes { wind: Vec3::new(1.0, 0.0, 2.0), air_density: 1.225, ..Attributes::default() };
    for _ in 0..16 {
        deformer.step(FRAME, &attributes)?;
    }
    let positions = deformer.positions()?.to_vec();
    let moved = rms(&positions, &mesh.positions);
    Ok((positions, moved))
}

/// Median ms a frame of a sheet hung by an edge, and its substeps. Frames are timed in groups, each waited for.
fn time(n: u32, quality: Quality, backend: Backend) -> Result<(f64, u32), Failure> {
    let options = Options { backend, quality, pinned: (0..n).collect(), ..Options::default() };
    let mut deformer = Deformer::new(&Mesh::grid(n, n, 1.0, 1.0), options)?;
    let (groups, frames) = if n > 256 { (5, 2) } else { (9, 4) };
    let mut substeps = 0;
    let mut times = Vec::new();
    for group in 0..=groups {
        let begin = Instant::now();
        for _ in 0..frames {
            substeps = deformer.step(FRAME, &Attributes::default())?.substeps;
        }
        deformer.wait()?;
        if group > 0 {
            times.push(begin.elapsed().as_secs_f64() * 1e3 / f64::from(frames));
        }
    }
    times.sort_by(f64::total_cmp);
    Ok((times[times.len() / 2], substeps))
}

fn rms(a: &[Vec3], b: &[Vec3]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| a.as_dvec3().distance_squared(b.as_dvec3())).sum();
    (sum / a.len() as f64).sqrt()
}
