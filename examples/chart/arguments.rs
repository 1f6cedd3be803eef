//! The command line: what can be said, and what each word means.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use clap::builder::PossibleValuesParser;
use clap::{Parser, value_parser};
use cloth_deformer::{Backend, Fabric};

use crate::Failure;
use crate::command::{self, one_of};
use crate::pins::Pin;

/// Names of the backends.
pub(crate) const BACKENDS: [(&str, Backend); 3] = [("cpu", Backend::Cpu), ("hybrid", Backend::Hybrid), ("gpu", Backend::Gpu)];

/// Charts error against milliseconds a frame, for every method and backend, and says which setting is the cheapest.
///
/// Without a mesh: sheets hung by an edge, against an explicit run in double precision. With one: your mesh, hung by its
/// edge, against a run of its own refined until halving its step no longer matters. Meters, kilograms, y up.
#[derive(Debug, Parser)]
#[command(
    name = "chart",
    after_help = "\
Writes chart_SCENE.svg and .csv, and strain.svg and .csv without a mesh. Prints the cheapest setting for each decade of
error, to paste after `cargo run --release --example drape -- MESH.obj`. Bending and air are left out: they cost the same
in every method. Exit codes: 0 done, 2 bad input, 4 no such GPU. Files are written whole or not at all."
)]
pub(crate) struct Arguments {
    /// Your cloth; without it, square sheets of 1 m
    #[arg(value_name = "MESH.obj")]
    pub(crate) mesh: Option<PathBuf>,

    /// Directory of the charts; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "charts")]
    pub(crate) out: PathBuf,

    /// Fewer and cheaper settings, smaller sheets
    #[arg(long)]
    pub(crate) quick: bool,

    /// Where the work is done [default: cpu, and hybrid and gpu if there is a real GPU]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = one_of(&BACKENDS))]
    pub(crate) backends: Vec<Backend>,

    /// Vertices along a side of the sheets [default: 32,64,128; 32,64 with --quick]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = value_parser!(u32).range(2..=2048))]
    pub(crate) sizes: Vec<u32>,

    /// Sweeps a substep of relaxation, a curve for each
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "20", value_parser = value_parser!(u32).range(1..=1000))]
    pub(crate) iterations: Vec<u32>,

    /// What your cloth is made of: its density and its stretch
    #[arg(long, value_name = "NAME", default_value = "cotton", value_parser = PossibleValuesParser::new(Fabric::PRESETS.iter().map(|(name, _)| *name)))]
    pub(crate) fabric: String,

    /// Vertices of your mesh that stay where they are: none; top: the highest, or the side of lowest z if it lies flat;
    /// corners: the four nearest the corners of its bounding rectangle; or numbers from 0, in the file's order
    #[arg(long, value_name = "none|top|corners|INDEX,..", default_value = "top")]
    pub(crate) pin: Pin,

    /// Milliseconds a frame that the strain chart grants each setting
    #[arg(long, value_name = "MS", default_value = "4", value_parser = positive)]
    pub(crate) budget: f64,

    /// The date to note [default: today]
    #[arg(long, value_name = "YYYY-MM-DD")]
    pub(crate) date: Option<String>,
}

impl Arguments {
    /// The arguments this process was given, or the help that was asked for.
    pub(crate) fn read() -> Result<Result<Arguments, clap::Error>, Failure> {
        command::read()
    }

    /// The fabric as far as every method and the reference know it: without bending.
    pub(crate) fn membrane(&self) -> Fabric {
        let preset = Fabric::PRESETS.iter().find(|(name, _)| *name == self.fabric);
        let fabric = preset.map_or(Fabric::default(), |&(_, fabric)| fabric);
        Fabric { bending: 0.0, damping: 0.0, ..fabric }
    }

    /// Today, or what was given.
    pub(crate) fn date(&self) -> String {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        self.date.clone().unwrap_or_else(|| civil_date(seconds / 86_400))
    }

    /// The command that was given, with files by their names alone: their places mean nothing elsewhere.
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
