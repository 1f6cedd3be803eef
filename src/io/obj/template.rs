//! Writes an OBJ again with other positions and everything else as it was.

use std::iter::repeat_n;
use std::ops::Range;
use std::path::Path;

use glam::{Vec2, Vec3};

use crate::io::atomic_file;
use crate::io::obj::file::read_file;
use crate::io::obj::normals::{Face, Normals};
use crate::io::obj::text::{place, statements};
use crate::io::obj::{ObjError, parse};
use crate::model::mesh::Mesh;

/// An OBJ file that can be written again with other positions. Polygons, texture coordinates, objects, groups,
/// smoothing, materials, comments and their order are kept byte for byte. A color after `x y z` in a `v` line is kept
/// too; a weight is removed, because positions are already divided by it.
///
/// Normals (`vn`) rotate with the polygons that use them, and hard edges stay hard: at each vertex, polygons that
/// shared a normal still share one. If the file uses one normal at several vertices (exporters merge the equal normals
/// of a flat sheet), it could only be right at each of them if faces referred to other normals. Faces are not changed,
/// so such a normal becomes the mean; [`ObjTemplate::shares_normals`] tells. In that case recompute the normals in the
/// program that reads the file, or export without normals. A normal that is not three finite numbers stays as it is.
///
/// ```
/// use cloth_deformer::{ObjTemplate, glam::Vec3};
/// let text = "o sheet\nv 0 0 0\nv 1 0 0\nv 1 0 1 # a corner\nv 0 0 1\nvt 0 0\nusemtl red\nf 1/1 2/1 3/1 4/1\n";
/// let template = ObjTemplate::parse(text.as_bytes())?;
/// let moved: Vec<Vec3> = template.mesh().positions.iter().map(|x| *x + Vec3::Y).collect();
/// assert!(template.write(&moved)?.starts_with(b"o sheet\nv 0 1 0\nv 1 1 0\nv 1 1 1 # a corner\n"));
/// # Ok::<(), cloth_deformer::ObjError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ObjTemplate {
    bytes: Vec<u8>,
    mesh: Mesh,
    polygons: Vec<Vec<u32>>,
    texture: Vec<Vec2>,
    is_textured: bool,
    /// The place in the file of the numbers of each `v`, and of each `vn`.
    vertices: Vec<Range<usize>>,
    normals: Option<Normals>,
}

impl ObjTemplate {
    /// Reads the OBJ file at `path`.
    ///
    /// # Errors
    /// As [`Mesh::load_obj`].
    pub fn load(path: impl AsRef<Path>) -> Result<ObjTemplate, ObjError> {
        let path = path.as_ref();
        ObjTemplate::new(read_file(path)?, Some(path))
    }

    /// Parses the bytes of an OBJ.
    ///
    /// # Errors
    /// As [`Mesh::parse_obj`].
    pub fn parse(bytes: &[u8]) -> Result<ObjTemplate, ObjError> {
        ObjTemplate::new(bytes.to_vec(), None)
    }

    fn new(bytes: Vec<u8>, file: Option<&Path>) -> Result<ObjTemplate, ObjError> {
        let mesh = parse(&String::from_utf8_lossy(&bytes), file)?;
        let text = in_ascii(&bytes);
        let (mut vertices, mut texture, mut normals, mut faces) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mark = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        for statement in statements(&text[mark..]) {
            let words: Vec<&str> = statement.words().collect();
            let span = |last: usize| place(&text, words[0]).start..place(&text, words[last]).end;
            match statement.keyword {
                // A fourth number is a weight, which divides the others.
                "v" => vertices.push(span(if words.len() == 4 { 3 } else { 2 })),
                "vt" => texture.push(number(&words, 0).zip(number(&words, 1)).map(Vec2::from)),
                "vn" => normals.push(vector(&words).map(|normal| (span(2), normal))),
                _ => faces.push(Face { corners: words, before: [vertices.len(), texture.len(), normals.len()] }),
            }
        }
        let polygons: Vec<Vec<u32>> = faces.iter().map(Face::vertices).collect();
        let are_whole = polygons.iter().zip(&faces).all(|(polygon, face)| polygon.len() == face.corners.len());
        if vertices.len() != mesh.positions.len() || !are_whole {
            let reason = "its statements were found in other places".to_owned();
            return Err(ObjError::Parser { file: file.map(Path::to_owned), reason });
        }
        let coordinate = |face: &Face<'_>, corner: &str| texture[face.named(corner, 1, texture.len())? as usize];
        let corners = faces.iter().flat_map(|face| face.corners.iter().map(move |corner| (face, corner)));
        let of_corners: Vec<Option<Vec2>> = corners.map(|(face, corner)| coordinate(face, corner)).collect();
        let is_textured = of_corners.iter().any(Option::is_some);
        let texture = of_corners.into_iter().collect::<Option<Vec<Vec2>>>().unwrap_or_default();
        let normals = Some(normals).filter(|normals: &Vec<_>| normals.iter().any(Option::is_some));
        let normals = normals.map(|normals| Normals::new(&mesh.positions, normals, &faces, &polygons));
        Ok(ObjTemplate { bytes, mesh, polygons, texture, is_textured, vertices, normals })
    }

    /// The mesh as read from the file.
    #[must_use]
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The vertices of each polygon, from 0, in the file's order. [`Mesh::triangles`] are cut from these.
    #[must_use]
    pub fn polygons(&self) -> &[Vec<u32>] {
        &self.polygons
    }

    /// Texture coordinates of all corners of all [`ObjTemplate::polygons`], in order; empty if any corner has none.
    #[must_use]
    pub fn texture_coordinates(&self) -> &[Vec2] {
        &self.texture
    }

    /// Whether any corner has texture coordinates. If others have none, [`ObjTemplate::texture_coordinates`] is empty all the same.
    #[must_use]
    pub fn is_textured(&self) -> bool {
        self.is_textured
    }

    /// Whether a normal is used at several vertices, and thus cannot be right at each of them when the cloth moves.
    #[must_use]
    pub fn shares_normals(&self) -> bool {
        self.normals.as_ref().is_some_and(|normals| normals.are_shared)
    }

    /// The file with other positions (m), one per vertex.
    ///
    /// # Errors
    /// [`ObjError::Mesh`] unless there is one finite position for each vertex.
    pub fn write(&self, positions: &[Vec3]) -> Result<Vec<u8>, ObjError> {
        self.written(positions, None)
    }

    /// Writes the file with other positions (m), one per vertex, to `path`, completely or not at all.
    ///
    /// # Errors
    /// As [`ObjTemplate::write`], or [`ObjError::Write`]. Whatever was at `path` is then unchanged.
    pub fn save(&self, positions: &[Vec3], path: impl AsRef<Path>) -> Result<(), ObjError> {
        let path = path.as_ref();
        let bytes = self.written(positions, Some(path))?;
        atomic_file::write(path, &bytes).map_err(|reason| ObjError::Write { file: path.to_owned(), reason })
    }

    fn written(&self, positions: &[Vec3], file: Option<&Path>) -> Result<Vec<u8>, ObjError> {
        let vertices = self.vertices.len();
        let problem = match positions.iter().position(|x| !x.is_finite()) {
            _ if positions.len() != vertices => Some(format!("{} positions were given for {vertices} vertices", positions.len())),
            Some(vertex) => Some(format!("vertex {vertex} is at {}; positions must be finite numbers", positions[vertex])),
            None => None,
        };
        if let Some(problem) = problem {
            return Err(ObjError::Mesh { file: file.map(Path::to_owned), problem });
        }
        let turned = self.normals.as_ref().map(|normals| normals.turned(&self.polygons, positions)).unwrap_or_default();
        let mut numbers: Vec<(&Range<usize>, Vec3)> = self.vertices.iter().zip(positions.iter().copied()).collect();
        numbers.extend(self.normals.iter().flat_map(|normals| &normals.places).zip(turned));
        numbers.sort_unstable_by_key(|(place, _)| place.start);
        let mut written = Vec::with_capacity(self.bytes.len() + 16 * numbers.len());
        let mut end = 0;
        for (place, Vec3 { x, y, z }) in numbers {
            written.extend_from_slice(&self.bytes[end..place.start]);
            written.extend(format!("{x} {y} {z}").bytes());
            end = place.end;
        }
        written.extend_from_slice(&self.bytes[end..]);
        Ok(written)
    }
}

/// The bytes with each character that is not ASCII replaced by as many bytes, so that places in the text are places in the
/// file: spaces, which separate words for the parser too, by spaces, and all else, which occurs in names and comments, by `?`.
fn in_ascii(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len());
    for chunk in bytes.utf8_chunks() {
        for letter in chunk.valid().chars() {
            match letter {
                _ if letter.is_ascii() => text.push(letter),
                _ => text.extend(repeat_n(if letter.is_whitespace() { ' ' } else { '?' }, letter.len_utf8())),
            }
        }
        text.extend(repeat_n('?', chunk.invalid().len()));
    }
    text
}

/// The numbers of a `vn` statement, or `None` if it does not have three of them.
fn vector(words: &[&str]) -> Option<Vec3> {
    (words.len() == 3).then(|| Some(Vec3::new(number(words, 0)?, number(words, 1)?, number(words, 2)?)))?
}

/// A word of a statement as a finite number.
fn number(words: &[&str], word: usize) -> Option<f32> {
    words.get(word)?.parse::<f32>().ok().filter(|number| number.is_finite())
}
