//! What can go wrong with a point cache that is written.

use std::io;
use std::path::PathBuf;

/// Why a point cache could not be written. What was at its path is as it was.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Pc2Error {
    /// The file could not be written.
    #[error("{}: cannot be written: {reason}; check the folder and the space left", .file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// What the system said.
        reason: io::Error,
    },
    /// More vertices or samples than the file's header can count.
    #[error("{count} {things} are too many for a point cache, which counts to 2147483647; split it")]
    TooMany {
        /// `vertices` or `samples`.
        things: &'static str,
        /// How many there are.
        count: usize,
    },
    /// A form that says what cannot be.
    #[error("{problem}")]
    Form {
        /// What is wrong with it, and what to do.
        problem: String,
    },
    /// A sample that is not one finite position for each vertex.
    #[error("sample {sample} has {problem}; give a finite position for each of the cache's {vertices} vertices")]
    Sample {
        /// The sample, from 1.
        sample: usize,
        /// What is wrong with it.
        problem: String,
        /// Number of vertices.
        vertices: usize,
    },
    /// A write failed in the middle of a sample: what came of the file is no point cache, and cannot become one.
    #[error("{}: sample {sample} was cut short when it could not be written; begin the cache anew", .file.display())]
    CutShort {
        /// The file.
        file: PathBuf,
        /// The sample, from 1.
        sample: usize,
    },
    /// Not as many samples as were announced.
    #[error("the cache was to hold {expected} samples, not {given}; write as many as PointCache::create was told")]
    Samples {
        /// Number of samples given, the one refused included.
        given: usize,
        /// Number of samples announced.
        expected: usize,
    },
}
