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

use std::{
    borrow::Cow,
    fmt::{self, Write},
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
};

use glam::Vec3;

use crate::io::atomic_file;
use crate::limits::{MAX_OBJ_BYTES, MAX_VERTICES};
use crate::model::mesh::Mesh;

/// Why an OBJ could not be read or written. The message is one line: file, line, what is wrong, what to do.
///
/// Vertices and faces of a file are counted from 1, as in the file itself.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ObjError {
    /// The file does not exist, is a folder or a device, or may not be read.
    #[error("{}: cannot be read: {reason}; check the path", .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The error of the operating system.
        reason: io::Error,
    },
    /// The file is longer than any valid mesh. Reading stops at the limit.
    #[error(
        "{}: has more than {limit} bytes, the most for a mesh of {most} vertices; leave out all but `v` and `f`, or split it",
        .file.display(), limit = MAX_OBJ_BYTES, most = MAX_VERTICES
    )]
    TooLong {
        /// The file.
        file: PathBuf,
    },
    /// The file could not be written. Whatever was there before is unchanged.
    #[error("{}: cannot be written: {reason}; check the folder and the space left", .file.display())]
    Write {
        /// The file.
        file: PathBuf,
        /// The error of the operating system.
        reason: io::Error,
    },
    /// The text has no vertex.
    #[error("{}no vertices; give at least one line `v x y z`", Location(.file.as_ref(), None))]
    NoVertices {
        /// The file, if the text was read from one.
        file: Option<PathBuf>,
    },
    /// The text has more vertices than a mesh may have.
    #[error("{}more than {most} vertices, the most that a mesh may have; split it", Location(.file.as_ref(), None), most = MAX_VERTICES)]
    TooManyVertices {
        /// The file, if the text was read from one.
        file: Option<PathBuf>,
    },
    /// A `v` statement is not a position.
    #[error("{}vertex {vertex} {problem}", Location(.file.as_ref(), Some(*.line)))]
    Vertex {
        /// The file, if the text was read from one.
        file: Option<PathBuf>,
        /// The line, counted from 1.
        line: usize,
        /// The vertex, counted from 1.
        vertex: usize,
        /// What is wrong with it, and what to do.
        problem: String,
    },
    /// An `f` statement is not a face of the vertices so far.
    #[error("{}face {face} {problem}", Location(.file.as_ref(), Some(*.line)))]
    Face {
        /// The file, if the text was read from one.
        file: Option<PathBuf>,
        /// The line, counted from 1.
        line: usize,
        /// The face, counted from 1.
        face: usize,
        /// What is wrong with it, and what to do.
        problem: String,
    },
    /// The parser rejected a text although every line is valid. This is a defect of the crate, not of the file; please
    /// report it.
    #[error("{}the OBJ parser failed: {reason}; please report the file", Location(.file.as_ref(), None))]
    Parser {
        /// The file, if the text was read from one.
        file: Option<PathBuf>,
        /// The parser's message.
        reason: String,
    },
    /// The mesh would make an OBJ file that cannot be read back. Nothing was written.
    #[error("{}{problem}", Location(.file.as_ref(), None))]
    Mesh {
        /// The file to be written, if any.
        file: Option<PathBuf>,
        /// What is wrong with the mesh, and what to do. Vertices and triangles are counted from 0, as in [`Mesh`].
        problem: String,
    },
}

/// Formats as much as is known of `file:line: `, as compilers do.
struct Location<'a>(Option<&'a PathBuf>, Option<usize>);

impl fmt::Display for Location<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match (self.0, self.1) {
            (Some(file), Some(line)) => write!(f, "{}:{line}: ", file.display()),
            (Some(file), None) => write!(f, "{}: ", file.display()),
            (None, Some(line)) => write!(f, "line {line}: "),
            (None, None) => Ok(()),
        }
    }
}

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
    /// to a vertex that does not exist. Nothing is repaired.
    pub fn parse_obj(text: &str) -> Result<Mesh, ObjError> {
        parse(text, None)
    }

    /// Writes the mesh to an OBJ file, completely or not at all; see [`Mesh::write_obj`].
    ///
    /// # Errors
    /// As [`Mesh::write_obj`], or [`ObjError::Write`]. Whatever was at `path` is then unchanged.
    pub fn save_obj(&self, path: impl AsRef<Path>) -> Result<(), ObjError> {
        let path = path.as_ref();
        let text = write(self, Some(path))?;
        atomic_file::write(path, text.as_bytes()).map_err(|reason| ObjError::Write { file: path.to_owned(), reason })
    }

    /// The mesh as the text of an OBJ: a line `v x y z` for each vertex and a line `f a b c` for each triangle, both in
    /// their order. Numbers are the shortest decimals without exponents that read back bit for bit.
    ///
    /// # Errors
    /// [`ObjError::Mesh`] if [`Mesh::parse_obj`] would reject the text.
    pub fn write_obj(&self) -> Result<String, ObjError> {
        write(self, None)
    }
}

/// Reads a file.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, ObjError> {
    let bytes = read(path).map_err(|reason| ObjError::Read { file: path.to_owned(), reason })?;
    bytes.ok_or_else(|| ObjError::TooLong { file: path.to_owned() })
}

/// Reads a file; `None` if it has more bytes than an OBJ may have.
fn read(path: &Path) -> io::Result<Option<Vec<u8>>> {
    // Only the length of a regular file is known beforehand. A device is not even opened, because opening alone has an
    // effect on some.
    let found = fs::metadata(path)?;
    if is_device(&found) {
        return Err(io::Error::other("it is a device, not a file or a pipe"));
    }
    if found.len() > MAX_OBJ_BYTES {
        return Ok(None);
    }
    up_to(MAX_OBJ_BYTES, File::open(path)?)
}

#[cfg(unix)]
fn is_device(found: &fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    found.file_type().is_char_device() || found.file_type().is_block_device()
}

#[cfg(not(unix))]
fn is_device(_: &fs::Metadata) -> bool {
    false
}

/// Reads everything; `None` if there are more than `limit` bytes.
fn up_to(limit: u64, from: impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    from.take(limit + 1).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= limit).then_some(bytes))
}

/// A `v` or `f` statement and the line on which it begins.
struct Statement<'a> {
    line: usize,
    text: Cow<'a, str>,
}

impl Statement<'_> {
    fn is_vertex(&self) -> bool {
        self.text.starts_with('v')
    }
}

pub(super) fn parse(text: &str, file: Option<&Path>) -> Result<Mesh, ObjError> {
    let file = file.map(Path::to_owned);
    // The statements are found twice, because a list of them would be longer than the text.
    let vertices = statements(text).filter(Statement::is_vertex).take(MAX_VERTICES + 1).count();
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
    for statement in statements(text) {
        let line = statement.line;
        let words: Vec<&str> = statement.text.split_whitespace().collect();
        if statement.is_vertex() {
            vertex += 1;
            let [x, y, z, weight] =
                check_vertex(&words[1..]).map_err(|problem| ObjError::Vertex { file: file.clone(), line, vertex, problem })?;
            _ = writeln!(source, "v {x} {y} {z} {weight}");
        } else {
            face += 1;
            check_face(&words[1..], vertex, vertices).map_err(|problem| ObjError::Face {
                file: file.clone(),
                line,
                face,
                problem,
            })?;
            source.push_str(&statement.text);
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

/// The text's `v` and `f` statements, without comments and with continued lines joined.
///
/// Only these statements are continued: a path or a comment may end in `\` and must not swallow the vertex on the next
/// line.
fn statements(text: &str) -> impl Iterator<Item = Statement<'_>> {
    // `tobj` would read a byte order mark as part of the first word, and lose that vertex.
    let mut lines = text.strip_prefix('\u{feff}').unwrap_or(text).lines().zip(1..);
    std::iter::from_fn(move || {
        let is_statement = |&(line, _): &(&str, usize)| {
            let line = bare(line);
            let uncontinued = line.strip_suffix('\\').unwrap_or(line);
            matches!(uncontinued.split_whitespace().next(), Some("v" | "f"))
        };
        let (line, number) = lines.find(is_statement)?;
        let mut text = Cow::Borrowed(bare(line));
        while text.ends_with('\\') {
            let joined = text.to_mut();
            joined.pop();
            joined.push(' ');
            joined.push_str(lines.next().map_or("", |(line, _)| bare(line)));
        }
        Some(Statement { line: number, text })
    })
}

/// A line without its comment and the surrounding space.
pub(super) fn bare(line: &str) -> &str {
    line.split('#').next().unwrap_or_default().trim()
}

/// The numbers of a vertex to pass to `tobj`: x, y, z and the weight that divides them.
fn check_vertex<'a>(words: &[&'a str]) -> Result<[&'a str; 4], String> {
    let number = |word: &str| word.parse::<f32>().ok();
    let (&[x, y, z], after) = match words.split_first_chunk() {
        Some(split) if matches!(split.1.len(), 0 | 1 | 3 | 4) => split,
        _ => return Err(format!("has {} numbers; give it x, y and z", words.len())),
    };
    if ![x, y, z].into_iter().all(|word| number(word).is_some_and(f32::is_finite)) {
        return Err(format!("is at ({}, {}, {}); positions must be finite numbers", short(x), short(y), short(z)));
    }
    if let Some(word) = after.iter().find(|word| number(word).is_none()) {
        return Err(format!("has `{}` after x, y and z; that must be a weight or a color in numbers, or nothing", short(word)));
    }
    let &[weight] = after else { return Ok([x, y, z, "1"]) };
    let divided = |word| Some(number(word)? / number(weight)?);
    match number(weight) {
        Some(w) if w.is_finite() && [x, y, z].into_iter().all(|word| divided(word).is_some_and(f32::is_finite)) => {
            Ok([x, y, z, weight])
        }
        _ => Err(format!("has the weight {}, and positions divided by it must be finite; leave it out", short(weight))),
    }
}

/// `before` is the number of vertices before the face, from which negative indices count back.
fn check_face(corners: &[&str], before: usize, vertices: usize) -> Result<(), String> {
    if corners.len() < 3 {
        return Err(format!("has {} corners; give it three or more", corners.len()));
    }
    corners.iter().try_for_each(|corner| {
        let mut parts = corner.split('/');
        let index = parts.next().and_then(|part| part.parse::<isize>().ok());
        // Texture and normal indices are not looked up, so they only need to be numbers.
        let rest = parts.clone().count() <= 2 && parts.all(|part| part.is_empty() || part.parse::<isize>().is_ok());
        match index.filter(|_| rest) {
            None => Err(format!("has the corner `{}`; write it as v, v/vt, v//vn or v/vt/vn", short(corner))),
            Some(0) => Err("names vertex 0; vertices are counted from 1".to_owned()),
            Some(index) if index > 0 && index.unsigned_abs() > vertices => {
                Err(format!("names vertex {index}, but the last one is {vertices} (counted from 1)"))
            }
            Some(index) if index < 0 && index.unsigned_abs() > before => {
                Err(format!("names vertex {index}, but only {before} come before it; count back from the face"))
            }
            Some(_) => Ok(()),
        }
    })
}

/// A word from a file, which may contain anything, made fit for an error message of one line.
fn short(word: &str) -> String {
    const LIMIT: usize = 32;
    let cut = word.chars().nth(LIMIT).map_or("", |_| "...");
    word.chars().take(LIMIT).flat_map(char::escape_debug).collect::<String>() + cut
}

fn write(mesh: &Mesh, file: Option<&Path>) -> Result<String, ObjError> {
    let vertices = mesh.positions.len();
    let problem = |problem| Err(ObjError::Mesh { file: file.map(Path::to_owned), problem });
    if vertices == 0 {
        return problem("the mesh has no vertices; give it at least one".to_owned());
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

#[cfg(test)]
#[path = "../../tests/unit/io_obj.rs"]
mod tests;
