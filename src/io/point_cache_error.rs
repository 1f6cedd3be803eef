//! Errors in writing a point cache.

use std::io;
use std::path::PathBuf;

/// Why a point cache could not be written. Whatever was at its path is unchanged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PointCacheError {
    /// The file could not be written.
    #[error("{}: cannot be written: {reason}; check the folder and the space left", .file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// The error of the operating system.
        reason: io::Error,
    },
    /// More vertices or samples than the file's header can express.
    #[error("{count} {things} are too many for a point cache, which counts to 2147483647; split it")]
    TooMany {
        /// `vertices` or `samples`.
        things: &'static str,
        /// Their number.
        count: usize,
    },
    /// The [`CacheForm`](crate::CacheForm) has invalid content.
    #[error("{problem}")]
    Form {
        /// What is wrong with it, and what to do.
        problem: String,
    },
    /// A sample is not one finite position for each vertex.
    #[error("sample {sample} has {problem}; give a finite position for each of the cache's {vertices} vertices")]
    Sample {
        /// The sample, counted from 1.
        sample: usize,
        /// What is wrong with it.
        problem: String,
        /// Number of vertices.
        vertices: usize,
    },
    /// A write failed within a sample. What has been written is not a valid point cache and cannot become one.
    #[error("{}: sample {sample} was cut short when it could not be written; begin the cache anew", .file.display())]
    CutShort {
        /// The file.
        file: PathBuf,
        /// The sample, counted from 1.
        sample: usize,
    },
    /// The number of samples is not the number announced.
    #[error("the cache was created for {expected} samples, not {given}; write exactly that many")]
    Samples {
        /// Number of samples given, including the one that was refused.
        given: usize,
        /// Number of samples announced.
        expected: usize,
    },
}
