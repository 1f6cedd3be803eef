//! Mesh colliders from OBJ files: one file for the whole run, or one for each frame.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloth_deformer::Mesh;
use cloth_deformer::glam::Vec3;

use crate::Failure;
use crate::receipt::hash;

/// A mesh collider that may move.
pub(super) struct Body {
    /// The files that it was read from.
    pub(super) files: Vec<PathBuf>,
    /// Each mesh, with the time (s) from which on it applies.
    meshes: Vec<(f64, Arc<Mesh>)>,
}

impl Body {
    /// Reads one file; or, if its name contains `#`, numbered files, one for the frame at each of `times` (s).
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
                return Err(wrong("its faces differ from those of the first frame, so the vertices cannot move from there"));
            }
            mesh.positions.iter_mut().for_each(|x| *x *= scale.unwrap_or(1.0));
            body.files.push(file);
            body.meshes.push((time, Arc::new(mesh)));
        }
        Ok(body)
    }

    /// The mesh at `time` (s).
    pub(super) fn at(&self, time: f64) -> Arc<Mesh> {
        let later = self.meshes.partition_point(|&(begins, _)| begins <= time + 1e-9);
        Arc::clone(&self.meshes[later.max(1) - 1].1)
    }
}

/// The text by which `--resume` recognizes a run contains a hash of the vertices.
impl fmt::Debug for Body {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers = self.meshes.iter().flat_map(|(_, mesh)| &mesh.positions).flat_map(Vec3::to_array);
        let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
        write!(f, "Body({} meshes, {})", self.meshes.len(), hash(&bytes))
    }
}
