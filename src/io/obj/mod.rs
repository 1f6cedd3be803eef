//! Reading and writing meshes as Wavefront OBJ.
//!
//! Reading uses `tobj`, which is made for rendering: it renumbers vertices in the order in which faces use them, drops
//! unused ones, splits at every `o`, `g` and known `usemtl`, turns a polyline (`l 1 2 3`) into a triangle, and skips
//! faces with two corners. A cloth needs the file's own vertices. Therefore `tobj` is given only the file's `v` and `f`
//! statements, preceded by one polygon through all vertices in the file's order. Numbering by first use is then the
//! file's numbering, no vertex is unused, and there are no groups to split at; the triangles of that polygon come first
//! and are removed. (Hiding indices in vertex colors would work too, up to 2^24, but needs a search afterwards.)
//!
//! `tobj`'s errors name no line, and it accepts NaN and 1e999, so each statement is checked before it is passed on.

mod error;
mod file;
mod normals;
pub(crate) mod template;
mod text;

pub use error::ObjError;

use std::fmt::Write as _;
use std::path::Path;

use glam::Vec3;

use crate::io::atomic_file;
use crate::io::obj::error::MAX_OBJ_BYTES;
use crate::io::obj::file::read_file;
use crate::io::obj::text::{Statement, check_face, check_vertex, statements};
use crate::kernels::limits::MAX_VERTICES;
use crate::model::mesh::Mesh;

impl Mesh {
    /// Reads the OBJ file at `path`; see [`Mesh::parse_obj`]. Bytes that are not UTF-8 are allowed in names and
    /// comments.
    ///
    /// The path may be a pipe but not a device. At most 4 GiB are read, enough for the 2^24 vertices that a mesh may
    /// have.
    ///
    /// # Errors
    /// [`ObjError::Read`] or [`ObjError::TooLong`], or the errors of [`Mesh::parse_obj`] with the file's name.
    pub fn load_obj(path: impl AsRef<Path>) -> Result<Mesh, ObjError> {
        let path = path.as_ref();
        parse(&String::from_utf8_lossy(&read_file(path)?), Some(path))
    }

    /// Parses the text of an OBJ. Its `v` lines are the vertices (m) in their order, used or not; its `f` lines are the
    /// triangles in their order, with polygons split into a fan from their first corner.
    ///
    /// Corners are joined by position index alone: texture and normal seams, objects and groups do not cut the cloth.
    /// Indices may be negative (counted back from the face's line), lines may be continued by `\` and commented with
    /// `#`. A single number after `x y z` is a weight that divides them, as in `tobj`; three or four numbers are a
    /// color and are ignored. All statements but `v` and `f` are ignored: materials need not exist, and polylines (`l`)
    /// and points (`p`) are not faces. A text without faces is a mesh of unconnected points.
    ///
    /// ```
    /// let mesh = cloth_deformer::Mesh::parse_obj("v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nf 1 2 3 4\n")?;
    /// assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    /// # Ok::<(), cloth_deformer::ObjError>(())
    /// ```
    ///
    /// # Errors
    /// If there is no vertex, a position is not three finite numbers, or a face has fewer than three corners or refers
    /// to a vertex that does not exist; if the text seems to be UTF-16, or has no line feeds. Nothing is repaired.
    pub fn parse_obj(text: &str) -> Result<Mesh, ObjError> {
        parse(text, None)
    }

    /// Writes the mesh to an OBJ file, completely or not at all; see [`Mesh::write_obj`].
    ///
    /// # Errors
    /// As [`Mesh::write_obj`], [`ObjError::TooLong`] if [`Mesh::load_obj`] would reject the file, or [`ObjError::Write`]. Whatever was at `path` is then unchanged.
    pub fn save_obj(&self, path: impl AsRef<Path>) -> Result<(), ObjError> {
        let path = path.as_ref();
        let text = write(self, Some(path))?;
        if text.len() as u64 > MAX_OBJ_BYTES {
            return Err(ObjError::TooLong { file: path.to_owned() });
        }
        atomic_file::write(path, text.as_bytes()).map_err(|reason| ObjError::Write { file: path.to_owned(), reason })
    }

    /// The mesh as the text of an OBJ: a line `v x y z` for each vertex and a line `f a b c` for each triangle, both in
    /// their order. Numbers are the shortest decimals without exponents that read back bit for bit.
    ///
    /// # Errors
    /// [`ObjError::TooManyVertices`] or [`ObjError::Mesh`] if [`Mesh::parse_obj`] would reject the text.
    pub fn write_obj(&self) -> Result<String, ObjError> {
        write(self, None)
    }
}

pub(super) fn parse(text: &str, file: Option<&Path>) -> Result<Mesh, ObjError> {
    let file = file.map(Path::to_owned);
    if !text.contains('\n') && text.trim_end().contains('\r') {
        return Err(ObjError::Text { file, problem: "its lines end in carriage returns alone; save it with line feeds" });
    }
    // The statements are found twice, because a list of them would be longer than the text.
    let vertices = statements(text).filter(Statement::is_vertex).take(MAX_VERTICES + 1).count();
    if vertices == 0 && text.starts_with("POINTCACHE2") {
        return Err(ObjError::Text {
            file,
            problem: "it is a point cache; meshes are OBJ files, a moving one a file for each frame",
        });
    }
    if vertices == 0 && text.contains('\0') {
        return Err(ObjError::Text { file, problem: "it has zero bytes, as a text in UTF-16 has; save it in UTF-8" });
    }
    if vertices == 0 {
        return Err(ObjError::NoVertices { file });
    }
    if vertices > MAX_VERTICES {
        return Err(ObjError::TooManyVertices { file });
    }

    let mut source = String::with_capacity(text.len() + 8 * vertices);
    source.push('f');
    (1..=vertices).for_each(|vertex| _ = write!(source, " {vertex}"));
    source.push('\n');
    let (mut vertex, mut face) = (0, 0);
    for statement in statements(text).filter(Statement::is_of_mesh) {
        let line = statement.line;
        let words: Vec<&str> = statement.words().collect();
        if statement.is_vertex() {
            vertex += 1;
            let [x, y, z, weight] =
                check_vertex(&words).map_err(|problem| ObjError::Vertex { file: file.clone(), line, vertex, problem })?;
            _ = writeln!(source, "v {x} {y} {z} {weight}");
        } else {
            face += 1;
            check_face(&words, vertex, vertices).map_err(|problem| ObjError::Face { file: file.clone(), line, face, problem })?;
            source.push('f');
            words.iter().for_each(|corner| source.extend([" ", corner]));
            source.push('\n');
        }
    }

    // Not `single_index`, which would split vertices at seams.
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let loaded = tobj::load_obj_buf(&mut source.as_bytes(), &options, |_| Err(tobj::LoadError::OpenFileFailed));
    let models = match loaded {
        Ok((models, _materials)) => models,
        Err(error) => return Err(ObjError::Parser { file, reason: error.to_string() }),
    };
    // `tobj` makes one triangle even of a polygon with one or two corners.
    let ahead = vertices.max(3) - 2;
    match models.as_slice() {
        [model] if model.mesh.positions.len() == 3 * vertices && model.mesh.indices.len() >= 3 * ahead => Ok(Mesh {
            positions: model.mesh.positions.chunks_exact(3).map(Vec3::from_slice).collect(),
            triangles: model.mesh.indices[3 * ahead..].chunks_exact(3).map(|corner| [corner[0], corner[1], corner[2]]).collect(),
        }),
        _ => Err(ObjError::Parser { file, reason: "it lost vertices".to_owned() }),
    }
}

fn write(mesh: &Mesh, file: Option<&Path>) -> Result<String, ObjError> {
    let vertices = mesh.positions.len();
    let problem = |problem| Err(ObjError::Mesh { file: file.map(Path::to_owned), problem });
    if vertices == 0 {
        return problem("the mesh has no vertices; give it at least one".to_owned());
    }
    if vertices > MAX_VERTICES {
        return Err(ObjError::TooManyVertices { file: file.map(Path::to_owned) });
    }
    let mut text = String::with_capacity(40 * vertices + 24 * mesh.triangles.len());
    for (vertex, position) in mesh.positions.iter().enumerate() {
        let &Vec3 { x, y, z } = position;
        if !position.is_finite() {
            return problem(format!("vertex {vertex} is at ({x}, {y}, {z}); positions must be finite numbers"));
        }
        _ = writeln!(text, "v {x} {y} {z}");
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(index) = corners.iter().find(|&&index| index as usize >= vertices) {
            return problem(format!(
                "triangle {triangle} names vertex {index}, but the mesh has {vertices} vertices (numbered from 0)"
            ));
        }
        let [a, b, c] = corners.map(|index| u64::from(index) + 1);
        _ = writeln!(text, "f {a} {b} {c}");
    }
    Ok(text)
}
