//! Writing point caches: the positions of a mesh, frame by frame, in one file of a format in
//! [`cache_form`](crate::io::cache_form).

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::Vec3;

use crate::io::atomic_file::AtomicFile;
use crate::io::cache_form::CacheForm;
use crate::io::point_cache_error::PointCacheError;
use crate::model::mesh::bounds;

/// Writes a point cache: create it for a number of samples, push each sample, and finish it. Until it is finished,
/// whatever was at its path is unchanged; dropped before that, it leaves nothing behind.
///
/// ```
/// # use cloth_deformer::{Attributes, Backend, Deformer, Mesh, Options, PointCache};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("towel.pc2");
/// let mesh = Mesh::grid(20, 20, 1.0, 1.0);
/// let mut cloth = Deformer::new(&mesh, Options { backend: Backend::Cpu, pinned: vec![0, 19], ..Options::default() })?;
/// let mut cache = PointCache::create(&path, mesh.positions.len(), 10)?;
/// cache.push(&mesh.positions)?; // frame 1 is the mesh at rest
/// for _ in 2..=10 {
///     cloth.step(1.0 / 60.0, &Attributes::default())?;
///     cache.push(cloth.positions()?)?;
/// }
/// cache.finish()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct PointCache {
    path: PathBuf,
    file: AtomicFile,
    form: CacheForm,
    /// Bounding box of each sample (m), if the format needs it.
    boxes: Vec<[Vec3; 2]>,
    vertices: usize,
    samples: usize,
    /// Number of samples written, and whether a write failed within the next one.
    given: usize,
    cut_short: bool,
}

impl PointCache {
    /// Begins a PC2 file for `samples` samples of `vertices` vertices, one per frame, the first at frame 1.
    ///
    /// # Errors
    /// If the file cannot be created, as where there is a directory, or a number is too large for the format.
    pub fn create(path: impl AsRef<Path>, vertices: usize, samples: usize) -> Result<PointCache, PointCacheError> {
        PointCache::create_as(CacheForm::Pc2, path, vertices, samples)
    }

    /// Begins a point cache in a given format for `samples` samples of `vertices` vertices, one per frame, the first at
    /// frame 1.
    ///
    /// # Errors
    /// As [`PointCache::create`], or if the format's parameters are invalid.
    pub fn create_as(
        form: CacheForm,
        path: impl AsRef<Path>,
        vertices: usize,
        samples: usize,
    ) -> Result<PointCache, PointCacheError> {
        let path = path.as_ref().to_path_buf();
        let counts = form.check(vertices, samples)?;
        let begun = AtomicFile::create(&path).and_then(|mut file| form.write_header(&mut file, counts).map(|()| file));
        match begun {
            Ok(file) => Ok(PointCache { path, file, form, boxes: Vec::new(), vertices, samples, given: 0, cut_short: false }),
            Err(reason) => Err(PointCacheError::Write { file: path, reason }),
        }
    }

    /// Writes the next sample: positions (m), one per vertex, in the mesh's order.
    ///
    /// # Errors
    /// If there are more samples than announced, the number of positions is wrong, one is not finite, or writing fails.
    /// A refused sample is not written, and another one may be pushed in its place. A failed write may leave part of a
    /// sample, so every call after it fails.
    pub fn push(&mut self, positions: &[Vec3]) -> Result<(), PointCacheError> {
        self.check_whole()?;
        let sample = self.given + 1;
        if sample > self.samples {
            return Err(PointCacheError::Samples { given: sample, expected: self.samples });
        }
        let problem = match positions.iter().position(|x| !x.is_finite()) {
            _ if positions.len() != self.vertices => Some(format!("{} positions", positions.len())),
            Some(vertex) => Some(format!("vertex {vertex} at {}", positions[vertex])),
            None => None,
        };
        if let Some(problem) = problem {
            return Err(PointCacheError::Sample { sample, problem, vertices: self.vertices });
        }
        if matches!(self.form, CacheForm::Usda { .. }) {
            self.boxes.push(if positions.is_empty() { [Vec3::ZERO; 2] } else { bounds(positions) });
        }
        if let Err(reason) = self.form.write_sample(&mut self.file, sample, positions) {
            self.cut_short = true;
            return Err(PointCacheError::Write { file: self.path.clone(), reason });
        }
        self.given = sample;
        Ok(())
    }

    /// Completes the file and moves it to its path.
    ///
    /// # Errors
    /// If samples are missing, a write failed before, or the file cannot be moved.
    pub fn finish(mut self) -> Result<(), PointCacheError> {
        self.check_whole()?;
        if self.given < self.samples {
            return Err(PointCacheError::Samples { given: self.given, expected: self.samples });
        }
        let footer = self.form.footer(&self.boxes);
        let written = self.file.write_all(&footer).and_then(|()| self.file.finish());
        written.map_err(|reason| PointCacheError::Write { file: self.path, reason })
    }

    fn check_whole(&self) -> Result<(), PointCacheError> {
        if self.cut_short { Err(PointCacheError::CutShort { file: self.path.clone(), sample: self.given + 1 }) } else { Ok(()) }
    }
}
