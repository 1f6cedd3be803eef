//! Bodies: meshes from OBJ files, one for the whole run or one for each frame.

use std::fmt;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloth_deformer::Mesh;

use crate::Failure;

/// A body that may move.
pub(super) struct Body {
    /// Files that it was read from.
    pub(super) files: Vec<PathBuf>,
    /// From when (s) on it is as in which file.
    meshes: Vec<(f64, Arc<Mesh>)>,
}

impl Body {
    /// From a file; or if there are `#` in its name, from numbered ones, for a frame at each of `times` (s).
    pub(super) fn load(path: &Path, scale: Option<f32>, times: impl Iterator<Item = f64>) -> Result<Body, Failure> {
        let pattern = path.to_string_lossy();
        let digits = pattern.matches('#').count();
        let marks = "#".repeat(digits);
        let mut body = Body { files: Vec::new(), meshes: Vec::new() };
        for (frame, time) in (1_u32..).zip(times).take(if digits == 0 { 1 } else { usize::MAX }) {
            let file = match digits {
                0 => path.to_path_buf(),
                _ => PathBuf::from(pattern.replacen(&marks, &format!("{frame:0digits$}"), 1)),
            };
            let mut mesh = Mesh::load_obj(&file).map_err(Failure::input)?;
            let wrong = |what: &str| Failure::input(format_args!("{}: {what}", file.display()));
            if mesh.triangles.is_empty() {
                return Err(wrong("no faces; give at least one line `f a b c`"));
            }
            if body.meshes.first().is_some_and(|(_, first)| first.triangles != mesh.triangles) {
                return Err(wrong("its faces are not those of the first frame, from which the vertices are to move here"));
            }
            mesh.positions.iter_mut().for_each(|x| *x *= scale.unwrap_or(1.0));
            body.files.push(file);
            body.meshes.push((time, Arc::new(mesh)));
        }
        Ok(body)
    }

    /// What it is after `time` (s).
    pub(super) fn at(&self, time: f64) -> Arc<Mesh> {
        let later = self.meshes.partition_point(|&(begins, _)| begins <= time + 1e-9);
        Arc::clone(&self.meshes[later.max(1) - 1].1)
    }
}

/// By this a run is known again: the files, and a hash of what is in them.
impl fmt::Debug for Body {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut hash = DefaultHasher::new();
        for (_, mesh) in &self.meshes {
            mesh.positions.iter().for_each(|x| x.to_array().map(f32::to_bits).hash(&mut hash));
        }
        write!(f, "Body({} meshes, {:x})", self.meshes.len(), hash.finish())
    }
}
