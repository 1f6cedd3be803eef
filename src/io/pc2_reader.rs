//! Reading PC2 point caches, sample by sample.

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use glam::Vec3;

/// Bytes of the header, and of one position.
const HEADER: usize = 32;
const POSITION: u64 = 12;

/// Why a point cache could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Pc2ReadError {
    /// The file does not exist or may not be read.
    #[error("{}: cannot be read: {reason}; check the path", .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The error of the operating system.
        reason: io::Error,
    },
    /// The file is not a PC2 of version 1, or is truncated.
    #[error("{}: {problem}", .file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// What is wrong with it, and what to do.
        problem: String,
    },
    /// The sample does not exist.
    #[error("{}: has {samples} samples, numbered from 0; there is no sample {sample}", .file.display())]
    Sample {
        /// The file.
        file: PathBuf,
        /// The sample requested, counted from 0.
        sample: usize,
        /// Number of samples in the file.
        samples: usize,
    },
}

/// Reads a PC2 file sample by sample, in any order. PC2 is written by [`PointCache`](crate::PointCache) and by other
/// programs.
///
/// ```
/// # use cloth_deformer::{Mesh, PointCache, PointCacheReader, glam::Vec3};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("body.pc2");
/// # let mesh = Mesh::grid(3, 3, 1.0, 1.0);
/// # let mut cache = PointCache::create(&path, 9, 1)?;
/// # cache.push(&mesh.positions)?;
/// # cache.finish()?;
/// let mut body = PointCacheReader::open(&path)?;
/// let mut positions = Vec::new();
/// for sample in 0..body.samples() {
///     body.read(sample, &mut positions)?;
///     assert_eq!(positions.len(), body.vertices());
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct PointCacheReader {
    path: PathBuf,
    file: BufReader<File>,
    vertices: usize,
    samples: usize,
    start: f32,
    rate: f32,
    bytes: Vec<u8>,
}

impl PointCacheReader {
    /// Opens the file at `path` and reads its header.
    ///
    /// # Errors
    /// If it cannot be read, is not a PC2 of version 1, or its length does not match the number of samples.
    pub fn open(path: impl AsRef<Path>) -> Result<PointCacheReader, Pc2ReadError> {
        let path = path.as_ref().to_path_buf();
        let refuse = |reason| Pc2ReadError::Read { file: path.clone(), reason };
        let found = fs::metadata(&path).map_err(refuse)?;
        let content = |problem: String| Pc2ReadError::Content { file: path.clone(), problem };
        // Opening a pipe waits until somebody writes to it.
        if !found.is_file() {
            return Err(content("is no file; copy what it gives to one".to_owned()));
        }
        let mut file = BufReader::new(File::open(&path).map_err(refuse)?);
        let mut header = [0; HEADER];
        if found.len() < HEADER as u64 || file.read_exact(&mut header).is_err() || !header.starts_with(b"POINTCACHE2\0") {
            return Err(content("is no PC2 file; it must begin with POINTCACHE2".to_owned()));
        }
        let word = |at: usize| std::array::from_fn(|k| header[at + k]);
        let [version, vertices, samples] = [12, 16, 28].map(|at| i32::from_le_bytes(word(at)));
        let [start, rate] = [20, 24].map(|at| f32::from_le_bytes(word(at)));
        if version != 1 {
            return Err(content(format!("is a PC2 file of version {version}; write it as version 1")));
        }
        let (Ok(vertices), Ok(samples)) = (usize::try_from(vertices), usize::try_from(samples)) else {
            return Err(content(format!("says that it has {samples} samples of {vertices} vertices; write it anew")));
        };
        if !(start.is_finite() && rate.is_finite()) {
            return Err(content(format!("says that it starts at frame {start}, a sample each {rate}; write it anew")));
        }
        let expected = (vertices as u64).saturating_mul(samples as u64).saturating_mul(POSITION).saturating_add(HEADER as u64);
        if found.len() != expected {
            let problem = format!(
                "has {} bytes, but {samples} samples of {vertices} vertices are {expected}; it was cut or altered",
                found.len()
            );
            return Err(content(problem));
        }
        Ok(PointCacheReader { path, file, vertices, samples, start, rate, bytes: Vec::new() })
    }

    /// Vertices in each sample.
    #[must_use]
    pub fn vertices(&self) -> usize {
        self.vertices
    }

    /// Number of samples.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// The frame of a sample, counted from 0, which the file gives by its first frame and the frames between samples.
    #[must_use]
    pub fn frame(&self, sample: usize) -> f32 {
        self.start + self.rate * sample as f32
    }

    /// Reads one sample, counted from 0: positions, one per vertex, unchanged.
    ///
    /// # Errors
    /// If the sample does not exist or cannot be read, or a position is not finite; `positions` is then unchanged.
    pub fn read(&mut self, sample: usize, positions: &mut Vec<Vec3>) -> Result<(), Pc2ReadError> {
        if sample >= self.samples {
            return Err(Pc2ReadError::Sample { file: self.path.clone(), sample, samples: self.samples });
        }
        let size = self.vertices as u64 * POSITION;
        self.bytes.resize(size as usize, 0);
        let at = self.file.seek(SeekFrom::Start(HEADER as u64 + sample as u64 * size));
        let read = at.and_then(|_| self.file.read_exact(&mut self.bytes));
        read.map_err(|reason| Pc2ReadError::Read { file: self.path.clone(), reason })?;
        let number = |bytes: &[u8]| f32::from_le_bytes(std::array::from_fn(|k| bytes[k]));
        let position = |bytes: &[u8]| Vec3::new(number(bytes), number(&bytes[4..]), number(&bytes[8..]));
        let read = || self.bytes.chunks_exact(POSITION as usize).map(position);
        if let Some((vertex, at)) = read().enumerate().find(|(_, position)| !position.is_finite()) {
            let problem = format!("sample {sample} has vertex {vertex} at {at}; positions must be finite numbers");
            return Err(Pc2ReadError::Content { file: self.path.clone(), problem });
        }
        positions.clear();
        positions.extend(read());
        Ok(())
    }
}
