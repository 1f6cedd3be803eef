//! Mesh colliders from OBJ files: one file for the whole run, or one for each frame.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloth_deformer::Mesh;
use cloth_deformer::glam::Vec3;

use super::timeline::Moment;
use crate::Failure;
use crate::receipt::hash;

/// A mesh collider that may move.
pub(super) struct Body {
    /// The files that it was read from.
    pub(super) files: Vec<PathBuf>,
    /// Each mesh, with the time (s) from which on it applies.
    meshes: Vec<(f64, Arc<Mesh>)>,
    /// The mesh at the start of the preroll.
    start: Option<Arc<Mesh>>,
}

impl Body {
    /// Reads one file; or, if its name contains `#` and is not that of a file, numbered files, one for the frame at each of
    /// `times` (s). Before, reads that of the start of the preroll, if any.
    pub(super) fn load(
        path: &Path,
        start: Option<&Path>,
        scale: Option<f32>,
        times: impl Iterator<Item = f64>,
    ) -> Result<Body, Failure> {
        // A folder may have a `#` in its name.
        let pattern = path.file_name().unwrap_or_default().to_string_lossy();
        let digits = if path.is_file() { 0 } else { pattern.matches('#').count() };
        let marks = "#".repeat(digits);
        if !pattern.contains(&marks) {
            return Err(Failure::input(format_args!(
                "{}: its `#` are apart, and only the digits of the frame's number may stand for them; give them in one place",
                path.display()
            )));
        }
        let mut body = Body { files: Vec::new(), meshes: Vec::new(), start: None };
        for (frame, time) in (1_u32..).zip(times).take(if digits == 0 { 1 } else { usize::MAX }) {
            let file = match digits {
                0 => path.to_path_buf(),
                _ => path.with_file_name(pattern.replacen(&marks, &format!("{frame:0digits$}"), 1)),
            };
            let mesh = body.read(file, scale)?;
            body.meshes.push((time, mesh));
        }
        body.start = start.map(|start| body.read(start.to_path_buf(), scale)).transpose()?;
        Ok(body)
    }

    /// Reads one of its files.
    fn read(&mut self, file: PathBuf, scale: Option<f32>) -> Result<Arc<Mesh>, Failure> {
        let mut mesh = Mesh::load_obj(&file).map_err(Failure::input)?;
        let wrong = |what: &str| Failure::input(format_args!("{}: {what}", file.display()));
        if mesh.triangles.is_empty() {
            return Err(wrong("no faces; give at least one line `f a b c`"));
        }
        let differs = |first: &Mesh| first.triangles != mesh.triangles || first.positions.len() != mesh.positions.len();
        if self.meshes.first().is_some_and(|(_, first)| differs(first)) {
            return Err(wrong(
                "its faces or vertices differ from those of the first frame, so the vertices cannot move from there",
            ));
        }
        mesh.positions.iter_mut().for_each(|x| *x *= scale.unwrap_or(1.0));
        self.files.push(file);
        Ok(Arc::new(mesh))
    }

    /// A hash of the faces, and of the vertices up to a moment. How many files follow depends on the length of the run.
    pub(super) fn until(&self, moment: Moment) -> String {
        let meshes = self.meshes.iter().filter(|&&(begins, _)| begins <= moment.time + 1e-9).map(|(_, mesh)| mesh);
        let numbers = meshes.chain(&self.start).flat_map(|mesh| &mesh.positions).flat_map(Vec3::to_array);
        let faces = self.meshes[0].1.triangles.as_flattened();
        let faces = faces.iter().copied().flat_map(u32::to_le_bytes);
        hash(&faces.chain(numbers.flat_map(f32::to_le_bytes)).collect::<Vec<u8>>())
    }

    /// The mesh at a moment. From its start its vertices go to frame 1 in straight lines.
    pub(super) fn at(&self, moment: Moment) -> Arc<Mesh> {
        let later = self.meshes.partition_point(|&(begins, _)| begins <= moment.time + 1e-9);
        let (_, mesh) = &self.meshes[later.max(1) - 1];
        match &self.start {
            Some(start) if moment.share < 1.0 => {
                let ways = start.positions.iter().zip(&mesh.positions);
                let positions = ways.map(|(from, to)| from.lerp(*to, moment.share)).collect();
                Arc::new(Mesh { positions, triangles: mesh.triangles.clone() })
            }
            _ => Arc::clone(mesh),
        }
    }
}

/// What the text by which `--resume` recognizes a run says of a body, besides [`Body::until`].
impl fmt::Debug for Body {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Body")
    }
}
