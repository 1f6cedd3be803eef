//! Finds the cheapest setting for a scene within a tolerance, and the effect of each of its terms: see `--help`.
//!
//! ```text
//! cargo run --release --example tune -- flag --tolerance 10mm
//! cargo run --release --example tune -- towel --tolerance 3%
//! ```

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use cloth_deformer::{Backend, Tolerance, Trial, Tuned, tune};

use crate::command::{Failure, say};
use crate::scenes::{Scene, scenes};

#[path = "../drape/command.rs"]
mod command;
#[path = "../../benches/quality/scenes.rs"]
mod scenes;

/// Simulates a scene up to twenty times and prints the cheapest setting that keeps a tolerance.
#[derive(Debug, Parser)]
struct Arguments {
    /// hang64, two-corners, towel, cape, flag or jerk; also square2K, tableCloth or skirt4K if `CLOTH_MESHES` names the folder with
    /// their meshes
    scene: String,
    /// Allowed error: a distance of the vertices (10mm), or a stretch of 99 % of the area (3%)
    #[arg(long, default_value = "10mm", value_parser = tolerance)]
    tolerance: Tolerance,
    /// Number of frames of 1/60 s [default: that of the scene]
    #[arg(long)]
    frames: Option<u32>,
    /// Processor that runs the simulation
    #[arg(long, default_value = "cpu", value_parser = command::one_of(&BACKENDS))]
    backend: Backend,
}

const BACKENDS: [(&str, Backend); 4] =
    [("auto", Backend::Auto), ("cpu", Backend::Cpu), ("hybrid", Backend::Hybrid), ("gpu", Backend::Gpu)];

fn tolerance(text: &str) -> Result<Tolerance, String> {
    let number =
        |text: &str| text.trim().parse::<f32>().map_err(|_| "give a distance such as 10mm, or a strain such as 3%".to_owned());
    match (text.strip_suffix("mm"), text.strip_suffix('%')) {
        (Some(text), _) => number(text).map(Tolerance::Position),
        (None, Some(text)) => number(text).map(|percent| Tolerance::Strain(percent / 100.0)),
        (None, None) => Err("give a distance such as 10mm, or a strain such as 3%".to_owned()),
    }
}

fn main() -> ExitCode {
    command::run(command::read(), run)
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
    show(&tuned, arguments.tolerance);
    Ok(())
}

fn show(tuned: &Tuned, tolerance: Tolerance) {
    let (unit, scale) = if matches!(tolerance, Tolerance::Strain(_)) { ("%", 100.0) } else { ("mm", 1.0) };
    if tuned.chaotic {
        say(
            "This motion is chaotic, so no two runs agree: where there is cloth and how fast it moves is compared, not each vertex.\n",
        );
    }
    if !tuned.terms.is_empty() {
        say("| without | error (mm) | ms saved | |\n|---|---|---|---|");
    }
    for term in &tuned.terms {
        let word = if term.dropped { "dropped" } else { "needed" };
        say(&format!("| {} | {:.2} | {:.2} | {word} |", term.name, term.error, term.milliseconds));
    }
    say(&format!("\n| setting | substeps | levels | error ({unit}) | in other frames | ms |\n|---|---|---|---|---|---|"));
    let row = |trial: &Trial| {
        let &Trial { setting, substeps, levels, error, checked, milliseconds, .. } = trial;
        let [error, checked] = [error, checked].map(|error| scale * error);
        say(&format!("| {setting} | {substeps:.0} | {levels} | {error:.2} | {checked:.2} | {milliseconds:.2} |"));
    };
    tuned.trials.iter().for_each(row);
    let Trial { setting, milliseconds, error, .. } = tuned.best;
    let times = tuned.resolved.map_or(String::new(), |resolved| {
        format!(", {:.1} times as fast as the resolved run", resolved.milliseconds / milliseconds)
    });
    say(&format!(
        "\nError {:.2} {unit} in {milliseconds:.2} ms per frame{times}:\n\n    Options {{ {setting}, ..options }}",
        scale * error
    ));
}
