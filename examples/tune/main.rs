//! Finds the cheapest setting for a scene within a tolerance, and the effect of each of its terms: see `--help`.
//!
//! ```text
//! cargo run --release --example tune -- flag --tolerance 10mm
//! cargo run --release --example tune -- towel --tolerance 3%
//! cargo run --release --example tune -- flag --chart flag.svg      # and draws what was tried
//! ```
//!
//! `drape --tune 10mm` does the same for a scene file or a mesh.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use cloth_deformer::{Backend, Tolerance, tune};

use crate::command::Failure;
use crate::scenes::{Scene, scenes};

#[path = "../../src/io/atomic_file.rs"]
mod atomic_file;
#[path = "../drape/command.rs"]
mod command;
#[allow(dead_code, reason = "the chart of methods uses all of it")]
#[path = "../chart/draw.rs"]
mod draw;
mod picture;
#[path = "../../benches/quality/scenes.rs"]
mod scenes;
#[path = "../drape/tuned.rs"]
mod tuned;

/// Simulates a scene up to twenty times and prints the cheapest setting that keeps a tolerance.
#[derive(Debug, Parser)]
struct Arguments {
    /// hang64, two-corners, towel, cape, flag or jerk; also square2K, tableCloth or skirt4K if `CLOTH_MESHES` names the folder with
    /// their meshes
    scene: String,
    /// Allowed error: a distance of the vertices (10mm), or a stretch of 99 % of the area (3%)
    #[arg(long, default_value = "10mm", value_parser = tuned::tolerance)]
    tolerance: Tolerance,
    /// Number of frames of 1/60 s [default: that of the scene]
    #[arg(long)]
    frames: Option<u32>,
    /// Processor that runs the simulation
    #[arg(long, default_value = "cpu", value_parser = command::one_of(&BACKENDS))]
    backend: Backend,
    /// SVG file for a chart of error against time of every run
    #[arg(long)]
    chart: Option<PathBuf>,
}

const BACKENDS: [(&str, Backend); 4] =
    [("auto", Backend::Auto), ("cpu", Backend::Cpu), ("hybrid", Backend::Hybrid), ("gpu", Backend::Gpu)];

fn main() -> ExitCode {
    command::run(run)
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let meshes = std::env::var_os("CLOTH_MESHES").map(PathBuf::from);
    let known = scenes(arguments.backend, meshes.as_deref()).map_err(Failure::input)?;
    let name = |scene: &Scene| scene.name.replace(' ', "-");
    let Some(scene) = known.iter().find(|scene| name(scene) == arguments.scene) else {
        let names: Vec<String> = known.iter().map(name).collect();
        return Err(Failure::input(format_args!("scene {}: not one of {}", arguments.scene, names.join(", "))));
    };
    let frames = arguments.frames.unwrap_or(scene.frames);
    let tuned = tune(&scene.mesh, &scene.options, &scene.script, frames, arguments.tolerance);
    let tuned = tuned.map_err(|error| Failure::from(&error))?;
    tuned::show(&tuned, arguments.tolerance);
    arguments.chart.as_deref().map_or(Ok(()), |path| save(path, &picture::chart(scene.name, &tuned, arguments.tolerance)))
}

fn save(path: &Path, chart: &draw::Chart) -> Result<(), Failure> {
    let svg = chart.svg().map_err(Failure::input)?;
    let written = atomic_file::write(path, svg.as_bytes());
    written.map_err(|error| Failure::input(format_args!("--chart {}: {error}; name a file that can be written", path.display())))
}
