//! Why an OBJ could not be read or written.

use std::fmt;
use std::io;
use std::path::PathBuf;

use crate::kernels::limits::MAX_VERTICES;

/// Most bytes of an OBJ that are read: 256 per vertex of the largest mesh, which leaves room for normals, texture
/// coordinates and two faces per vertex.
pub(super) const MAX_OBJ_BYTES: u64 = 256 * MAX_VERTICES as u64;

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
    /// The file is longer than any valid mesh, or would be. Reading stops at the limit; nothing is written.
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
    /// The text is not in lines of UTF-8.
    #[error("{}{problem}", Location(.file.as_ref(), None))]
    Text {
        /// The file, if the text was read from one.
        file: Option<PathBuf>,
        /// What it seems to be in, and what to do.
        problem: &'static str,
    },
    /// The text has no vertex.
    #[error("{}no vertices; give at least one line `v x y z`", Location(.file.as_ref(), None))]
    NoVertices {
        /// The file, if the text was read from one.
        file: Option<PathBuf>,
    },
    /// The text, or the mesh to be written, has more vertices than a mesh may have.
    #[error("{}more than {most} vertices, the most that a mesh may have; split it", Location(.file.as_ref(), None), most = MAX_VERTICES)]
    TooManyVertices {
        /// The file that was read or was to be written, if any.
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
        /// What is wrong with the mesh, and what to do. Vertices and triangles are counted from 0, as in [`Mesh`](crate::Mesh).
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
