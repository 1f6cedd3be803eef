//! Receipts: the inputs and results of a run. A variant with a matching receipt is not run again, and `diff` explains
//! differences by them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::{Failure, output::Output, report::Report};

/// Name of the file in a run's folder.
pub(crate) const NAME: &str = "receipt.json";

/// A receipt. It is the same for the same run on any machine, except for `lanes` and `adapter`, and with other lanes or a GPU the
/// figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Receipt {
    pub(crate) inputs: Inputs,
    pub(crate) backend: String,
    pub(crate) adapter: Option<String>,
    /// SIMD lanes of the processor. Machines with the same number compute the same bits.
    pub(crate) lanes: u32,
    pub(crate) figures: Figures,
}

/// Everything that a run depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Inputs {
    /// Version of this program.
    pub(crate) version: String,
    pub(crate) variant: u32,
    /// The variant's values of the varied keys.
    pub(crate) values: BTreeMap<String, serde_json::Value>,
    /// Hash of the scene with these values.
    pub(crate) scene: String,
    /// Hash of the other command line arguments.
    pub(crate) arguments: String,
    /// The files that were read.
    pub(crate) files: Vec<InputFile>,
}

/// A file that was read, by its name without the folder, and its hash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct InputFile {
    name: String,
    hash: String,
}

/// Results of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    frames: usize,
    substeps: u64,
    /// Value of the last frame.
    mean_strain: f32,
    /// Largest values of all frames, here and in the next two fields.
    max_strain: f32,
    stretch_share: f32,
    penetration: f32,
    /// Energy in the last frame (J).
    energy: f64,
    contacts: u64,
}

impl Figures {
    pub(crate) fn of(report: &Report) -> Figures {
        let largest = |of: fn(&crate::report::Frame) -> f32| report.frames.iter().map(of).fold(0.0, f32::max);
        let last = report.frames.last();
        Figures {
            frames: report.frames.len(),
            substeps: report.frames.iter().map(|frame| u64::from(frame.substeps)).sum(),
            mean_strain: last.map_or(0.0, |frame| frame.mean_strain),
            max_strain: largest(|frame| frame.max_strain),
            stretch_share: largest(|frame| frame.stretch_share),
            penetration: largest(|frame| frame.penetration),
            energy: last.map_or(0.0, |frame| frame.energy),
            contacts: report.frames.iter().map(|frame| u64::from(frame.contacts)).sum(),
        }
    }
}

impl Receipt {
    /// The receipt in a folder, or `None` if there is no readable one.
    pub(crate) fn in_folder(folder: &Path) -> Option<Receipt> {
        serde_json::from_slice(&fs::read(folder.join(NAME)).ok()?).ok()
    }

    pub(crate) fn write(&self, folder: &Path) -> Result<(), Failure> {
        let mut text = serde_json::to_vec_pretty(self).map_err(|error| Failure::input(format_args!("{NAME}: {error}")))?;
        text.push(b'\n');
        Output::reserve(&folder.join(NAME))?.write(&text)
    }
}

/// 64-bit FNV-1a (Fowler, Noll and Vo). It detects changes, but not deliberate forgery.
pub(crate) fn hash(bytes: &[u8]) -> String {
    let hash =
        bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

/// Names and hashes of files.
pub(crate) fn input_files(files: &[PathBuf]) -> Result<Vec<InputFile>, Failure> {
    let named = |path: &PathBuf| {
        let bytes = fs::read(path).map_err(|error| Failure::input(format_args!("{}: {error}", path.display())))?;
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Ok(InputFile { name, hash: hash(&bytes) })
    };
    files.iter().map(named).collect()
}

/// Number of SIMD lanes that the library uses on this processor.
pub(crate) fn lanes() -> u32 {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        return if is_x86_feature_detected!("avx512f") { 16 } else { 8 };
    }
    4
}
