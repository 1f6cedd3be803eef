//! Maps where the methods are stable: see `--help`, and `cell.rs` for the meaning of the labels.
//!
//! ```text
//! cargo run --release --example stability_map -- --out DIR
//! ```

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use cloth_deformer::Method;

use crate::cell::{Cell, Label, Outcome};
use crate::command::{Failure, say};
use crate::maps::{Map, Panel};

#[path = "../../src/io/atomic_file.rs"]
mod atomic_file;
mod cell;
#[path = "../drape/command.rs"]
#[expect(dead_code, reason = "drape's own")]
mod command;
#[path = "../../tests/common/mod.rs"]
mod common;
mod draw;
mod maps;
mod sheet;
mod theory;
mod truth;

/// Maps where each method is stable, as a function of the substep and of stiffness, resolution, bending, mass ratio or step ratio.
#[derive(Debug, Parser)]
#[command(
    name = "stability_map",
    after_help = "\
Writes stability_NAME.svg and .csv for each map. Prints the predictions first, then the number of cells by label.
Exit codes: 0 done, 1 small steps gained energy or became infinite, 2 bad input."
)]
struct Arguments {
    /// Folder for the maps; created if it does not exist
    #[arg(long, value_name = "DIR", default_value = "charts")]
    out: PathBuf,

    /// The maps to make [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = ["stiffness", "resolution", "bending", "mass", "steps"])]
    maps: Vec<String>,
}

fn main() -> ExitCode {
    command::run(run)
}

/// Runs the program from top to bottom.
fn run(arguments: &Arguments) -> Result<(), Failure> {
    let out = &arguments.out;
    fs::create_dir_all(out)
        .map_err(|error| Failure::input(format_args!("--out {}: {error}; name a directory that can be made", out.display())))?;
    let mut maps = Map::all();
    maps.retain(|map| arguments.maps.is_empty() || arguments.maps.iter().any(|name| name == map.name));
    maps.iter().for_each(predict);
    let start = Instant::now();
    let (mut cells, mut bad) = (0, 0);
    for map in &mut maps {
        eprintln!("{}: {} cells ..", map.title, map.count());
        map.run();
        save(out, map.name, "csv", &table(map))?;
        save(out, map.name, "svg", &draw::svg(map).map_err(Failure::input)?)?;
        cells += map.count();
        bad += map.panels.iter().map(|panel| summarize(map, panel)).sum::<usize>();
    }
    let limits = || maps.iter().flat_map(|map| &map.panels).flat_map(|panel| panel.lines.iter().map(move |line| (panel, line)));
    let names: BTreeSet<&str> = limits().filter(|(_, line)| line.is_limit).map(|(_, line)| line.name).collect();
    for name in names {
        let all = limits().filter(|(_, line)| line.is_limit && line.name == name);
        agree(name, &all.flat_map(|(panel, line)| panel.measured_over(line)).collect::<Vec<_>>());
    }
    say(&format!("{cells} cells in {:.0} s", start.elapsed().as_secs_f64()));
    if bad == 0 {
        return Ok(());
    }
    Err(Failure { code: 1, message: format!("small steps gained energy or became infinite in {bad} cells") })
}

/// Prints the predictions.
fn predict(map: &Map) {
    for panel in &map.panels {
        for line in &panel.lines {
            let [low, high] = [f64::min, f64::max].map(|pick| line.substeps.iter().copied().reduce(pick).unwrap_or(f64::NAN));
            say(&format!("predicted, {}, {}: {}: {low:.1} to {high:.1} substeps", map.name, panel.title, line.name));
        }
    }
}

/// Prints the results of a panel; returns the number of small-step cells that failed.
fn summarize(map: &Map, panel: &Panel) -> usize {
    let counts = Label::ALL.map(|label| format!("{} {}", panel.count(label), label.name()));
    say(&format!("{}, {}: {}", map.name, panel.title, counts.join(", ")));
    for line in panel.lines.iter().filter(|line| line.is_limit) {
        agree(line.name, &panel.measured_over(line));
    }
    let small = panel.columns.iter().all(|column| column.cells.iter().all(|cell| cell.method == Method::SmallSteps));
    if small { panel.count(Label::GainingEnergy) + panel.count(Label::NotFinite) } else { 0 }
}

/// Prints how close the measured limits are to a prediction.
fn agree(name: &str, ratios: &[f64]) {
    let within = ratios.iter().filter(|ratio| (1.0 / 1.1..=1.1).contains(*ratio)).count();
    let [low, high] = [f64::min, f64::max].map(|pick| ratios.iter().copied().reduce(pick).unwrap_or(f64::NAN));
    let share = 100.0 * within as f64 / ratios.len().max(1) as f64;
    say(&format!("  {name}: {share:.0} % of {} measured limits within 10 %, {low:.2} to {high:.2} of it", ratios.len()));
}

/// The CSV file.
fn table(map: &Map) -> String {
    let mut text = format!("# {}\n# cargo run --release --example stability_map -- --maps {}\n", map.title, map.name);
    text += "method,iterations,n,stretch,bending,mass_ratio,step_ratio,substeps_per_60th,longest_substep,label,gain_in_falls,\
        position_error,strain_error,resting_speed\n";
    for column in map.panels.iter().flat_map(|panel| &panel.columns) {
        for (cell, outcome) in column.cells.iter().zip(&column.outcomes) {
            let Cell { sheet, step_ratio, .. } = cell;
            let Outcome { label, h, gain, errors, speed } = outcome;
            let (method, iterations) = match cell.method {
                Method::Relaxation { iterations } => ("relaxation", iterations),
                Method::Springs => ("springs", 0),
                _ => ("small-steps", 1),
            };
            let measured =
                [*gain, errors[0], errors[1], *speed].map(|x| if x.is_nan() { String::new() } else { format!("{x:.3e}") });
            let (n, k, b, mass) = (sheet.n, sheet.stretch, sheet.bending, sheet.mass_ratio);
            let _ = writeln!(
                text,
                "{method},{iterations},{n},{k:.4e},{b:.4e},{mass:.4},{step_ratio:.4},{:.3},{h:.4e},{},{}",
                cell.rate(),
                label.name(),
                measured.join(",")
            );
        }
    }
    text
}

/// Writes a file completely or not at all.
fn save(out: &Path, name: &str, ending: &str, text: &str) -> Result<(), Failure> {
    let path = out.join(format!("stability_{name}.{ending}"));
    let written = atomic_file::write(&path, text.as_bytes());
    written.map_err(|error| Failure::input(format_args!("{}: {error}; name a writable --out", path.display())))
}
