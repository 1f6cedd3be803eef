//! The command line.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use clap::builder::PossibleValuesParser;
use clap::{Parser, value_parser};
use cloth_deformer::{Backend, Fabric};

use crate::command::one_of;
use crate::pins::Pin;

/// Names of the backends.
pub(crate) const BACKENDS: [(&str, Backend); 3] = [("cpu", Backend::Cpu), ("hybrid", Backend::Hybrid), ("gpu", Backend::Gpu)];

/// Charts error against time per frame, for every method and backend, and prints the cheapest settings.
///
/// Without a mesh: sheets hung by an edge, compared with an explicit run in double precision. With a mesh: your mesh,
/// hung by its edge, compared with its own reference run, refined until halving the time step no longer changes it.
/// Units are meters and kilograms, y is up.
#[derive(Debug, Parser)]
#[command(
    name = "chart",
    after_help = "\
Writes chart_SCENE.svg and .csv, and without a mesh also strain.svg and .csv. Prints the cheapest setting for each decade of
error, to append to `cargo run --release --example drape -- MESH.obj`. Bending and air are left out, because they cost the same
with every method. Exit codes: 0 done, 2 bad input, 4 GPU not available or failed. Files are written completely or not at all."
)]
pub(crate) struct Arguments {
    /// Your cloth; without it, square sheets of 1 m
    #[arg(value_name = "MESH.obj")]
    pub(crate) mesh: Option<PathBuf>,

    /// Folder for the charts; created if it does not exist
    #[arg(long, value_name = "DIR", default_value = "charts")]
    pub(crate) out: PathBuf,

    /// Fewer and cheaper settings, and smaller sheets
    #[arg(long)]
    pub(crate) quick: bool,

    /// Backends to run [default: cpu, and hybrid and gpu if there is a hardware GPU]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = one_of(&BACKENDS))]
    pub(crate) backends: Vec<Backend>,

    /// Vertices per side of the sheets [default: 32,64,128; 32,64 with --quick]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = value_parser!(u32).range(2..=2048))]
    pub(crate) sizes: Vec<u32>,

    /// Numbers of sweeps per substep for relaxation; each is a curve
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "20", value_parser = value_parser!(u32).range(1..=1000))]
    pub(crate) iterations: Vec<u32>,

    /// Fabric of your mesh, of which only density and stretch are used
    #[arg(long, value_name = "NAME", default_value = "cotton", value_parser = PossibleValuesParser::new(Fabric::PRESETS.iter().map(|(name, _)| *name)))]
    pub(crate) fabric: String,

    /// Pinned vertices of your mesh: none; top: the highest ones, or the side of lowest z if the mesh is horizontal;
    /// corners: the four nearest to the corners of its bounding rectangle; or vertex numbers from 0, in the file's
    /// order
    #[arg(long, value_name = "none|top|corners|INDEX,..", default_value = "top")]
    pub(crate) pin: Pin,

    /// Time per frame (ms) that each setting may take in the strain chart
    #[arg(long, value_name = "MS", default_value = "4", value_parser = positive)]
    pub(crate) budget: f64,

    /// Date to record [default: today]
    #[arg(long, value_name = "YYYY-MM-DD")]
    pub(crate) date: Option<String>,
}

impl Arguments {
    /// The fabric without bending, which the reference and some methods do not have.
    pub(crate) fn membrane(&self) -> Fabric {
        let preset = Fabric::PRESETS.iter().find(|(name, _)| *name == self.fabric);
        let fabric = preset.map_or(Fabric::default(), |&(_, fabric)| fabric);
        Fabric { bending: 0.0, damping: 0.0, ..fabric }
    }

    /// The date to record.
    pub(crate) fn date(&self) -> String {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        self.date.clone().unwrap_or_else(|| civil_date(seconds / 86_400))
    }

    /// The command that was given, with files by their names only, because their folders mean nothing on other
    /// machines.
    pub(crate) fn command() -> String {
        let name = |word: String| match Path::new(&word).file_name() {
            Some(name) if word.contains(std::path::MAIN_SEPARATOR) => name.to_string_lossy().into_owned(),
            _ => word,
        };
        let words: Vec<String> = std::env::args().skip(1).map(name).collect();
        format!("cargo run --release --example chart -- {}", words.join(" ")).trim_end_matches(" -- ").to_owned()
    }
}

/// The date of a day counted from 1970-01-01 (H. Hinnant, "chrono-compatible low-level date algorithms").
fn civil_date(days: u64) -> String {
    let z = days + 719_468;
    let (era, day) = (z / 146_097, z % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let march = (5 * day + 2) / 153;
    let month = if march < 10 { march + 3 } else { march - 9 };
    format!("{}-{month:02}-{:02}", era * 400 + year + u64::from(month <= 2), day - (153 * march + 2) / 5 + 1)
}

fn positive(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("it must be a finite number above 0".to_owned()),
    }
}
