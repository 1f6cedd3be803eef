//! The file formats of point caches.

use std::fmt::Write as _;
use std::io::{self, Write};

use glam::{Vec2, Vec3};

use crate::io::point_cache_error::PointCacheError;

/// The file format of a point cache. Positions are written unchanged, in meters; vertices are in the mesh's order.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum CacheForm {
    /// PC2, as read by Blender's Mesh Cache modifier and others. Little-endian: `POINTCACHE2` and a zero byte (12
    /// bytes), the version 1 (`i32`), the number of vertices (`i32`), the frame of the first sample (`f32`), frames per
    /// sample (`f32`), the number of samples (`i32`), then for each sample three `f32` per vertex. The file contains
    /// neither units nor axes.
    Pc2,
    /// MDD, as defined by `LightWave`. Big-endian: the number of samples (`i32`), the number of vertices (`i32`), the
    /// time of each sample (`f32`, s), then for each sample three `f32` per vertex.
    Mdd {
        /// Samples per second.
        fps: f32,
    },
    /// USD as text (usda): a `Mesh` whose points have a time sample for each frame, with units, up axis, frame rate and
    /// extent.
    Usda {
        /// Frames per second.
        fps: f32,
        /// The axis that points up.
        up: UpAxis,
        /// The corners of each polygon: triangles ([`Mesh::triangles`](crate::Mesh::triangles)), or the polygons of the
        /// input file ([`ObjTemplate::polygons`](crate::ObjTemplate::polygons)).
        faces: Vec<Vec<u32>>,
        /// Texture coordinates of all corners of all polygons, in order
        /// ([`ObjTemplate::texture_coordinates`](crate::ObjTemplate::texture_coordinates)); empty: none.
        texture: Vec<Vec2>,
    },
}

/// The axis that points up in a USD file. Positions are not changed for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// As in Maya, Houdini and glTF, and in the default [`Attributes::gravity`](crate::Attributes::gravity).
    #[default]
    Y,
    /// As in 3ds Max, in CAD and in robotics.
    Z,
}

impl UpAxis {
    /// The axis along which gravity acts, of the two.
    #[must_use]
    pub fn of(gravity: Vec3) -> UpAxis {
        if gravity.z.abs() > gravity.y.abs() { UpAxis::Z } else { UpAxis::Y }
    }

    /// A vector whose y component is up, for this axis: turned about x by 0 or 90 degrees, so that handedness is kept.
    #[must_use]
    pub fn turn(self, y_up: Vec3) -> Vec3 {
        match self {
            UpAxis::Y => y_up,
            UpAxis::Z => Vec3::new(y_up.x, -y_up.z, y_up.y),
        }
    }
}

impl CacheForm {
    /// The numbers of vertices and samples, as they are in a file of this format, if there can be one.
    pub(super) fn check(&self, vertices: usize, samples: usize) -> Result<[i32; 2], PointCacheError> {
        let count = |things, count: usize| i32::try_from(count).map_err(|_| PointCacheError::TooMany { things, count });
        let counts = [count("vertices", vertices)?, count("samples", samples)?];
        let wrong = |problem| Err(PointCacheError::Form { problem });
        match self {
            CacheForm::Pc2 => {}
            CacheForm::Mdd { fps } => {
                check_rate(*fps)?;
                if !((samples as f64 / f64::from(*fps)) as f32).is_finite() {
                    return wrong(format!(
                        "fps = {fps}; {samples} samples take more seconds than single precision holds; give a higher rate"
                    ));
                }
            }
            CacheForm::Usda { fps, faces, texture, .. } => {
                check_rate(*fps)?;
                let is_face = |face: &Vec<u32>| face.len() > 2 && face.iter().all(|&corner| (corner as usize) < vertices);
                if let Some(face) = faces.iter().position(|face| !is_face(face)) {
                    let corners = &faces[face];
                    return wrong(format!("face {face} has the corners {corners:?}; give three or more of {vertices} vertices"));
                }
                let corners: usize = faces.iter().map(Vec::len).sum();
                if !texture.is_empty() && texture.len() != corners {
                    let given = texture.len();
                    return wrong(format!(
                        "{given} texture coordinates were given for {corners} corners; give one for each, or none"
                    ));
                }
                if let Some(corner) = texture.iter().position(|uv| !uv.is_finite()) {
                    return wrong(format!("texture[{corner}] is {}; give finite numbers", texture[corner]));
                }
            }
        }
        Ok(counts)
    }

    /// Writes what comes before the first sample, for numbers from [`CacheForm::check`].
    pub(super) fn write_header(&self, file: &mut impl Write, [vertices, samples]: [i32; 2]) -> io::Result<()> {
        match self {
            CacheForm::Pc2 => {
                let (version, [start, rate]) = (1_i32.to_le_bytes(), [1_f32.to_le_bytes(); 2]);
                file.write_all(b"POINTCACHE2\0")?;
                file.write_all([version, vertices.to_le_bytes(), start, rate, samples.to_le_bytes()].as_flattened())
            }
            CacheForm::Mdd { fps } => {
                file.write_all(&samples.to_be_bytes())?;
                file.write_all(&vertices.to_be_bytes())?;
                // One by one, because there may be more samples than memory.
                let mut times = (0..samples).map(|sample| (f64::from(sample) / f64::from(*fps)) as f32);
                times.try_for_each(|time| file.write_all(&time.to_be_bytes()))
            }
            CacheForm::Usda { fps, up, faces, texture } => {
                file.write_all(usda_header(*fps, *up, faces, texture, samples).as_bytes())
            }
        }
    }

    /// Writes one sample; samples are counted from 1.
    pub(super) fn write_sample(&self, file: &mut impl Write, sample: usize, positions: &[Vec3]) -> io::Result<()> {
        let mut numbers = positions.iter().flat_map(Vec3::to_array);
        match self {
            CacheForm::Pc2 => numbers.try_for_each(|number| file.write_all(&number.to_le_bytes())),
            CacheForm::Mdd { .. } => numbers.try_for_each(|number| file.write_all(&number.to_be_bytes())),
            CacheForm::Usda { .. } => {
                write!(file, "        {sample}: [")?;
                for (index, Vec3 { x, y, z }) in positions.iter().enumerate() {
                    let comma = if index > 0 { ", " } else { "" };
                    write!(file, "{comma}({x}, {y}, {z})")?;
                }
                file.write_all(b"],\n")
            }
        }
    }

    /// The bytes after the last sample. `boxes` are the bounding boxes of the samples.
    pub(super) fn footer(&self, boxes: &[[Vec3; 2]]) -> Vec<u8> {
        let CacheForm::Usda { .. } = self else { return Vec::new() };
        let mut text = "    }\n    float3[] extent.timeSamples = {\n".to_owned();
        for ([low, high], sample) in boxes.iter().zip(1..) {
            _ = writeln!(text, "        {sample}: [({}, {}, {}), ({}, {}, {})],", low.x, low.y, low.z, high.x, high.y, high.z);
        }
        text.push_str("    }\n}\n");
        text.into_bytes()
    }
}

fn check_rate(fps: f32) -> Result<(), PointCacheError> {
    if fps > 0.0 && fps.is_finite() {
        Ok(())
    } else {
        Err(PointCacheError::Form { problem: format!("fps = {fps}; frames a second must be finite and above 0") })
    }
}

fn usda_header(fps: f32, up: UpAxis, faces: &[Vec<u32>], texture: &[Vec2], samples: i32) -> String {
    let list = |numbers: &mut dyn Iterator<Item = u32>| {
        let words: Vec<String> = numbers.map(|number| number.to_string()).collect();
        words.join(", ")
    };
    let counts = list(&mut faces.iter().map(|face| face.len() as u32));
    let corners = list(&mut faces.iter().flatten().copied());
    let mut st = String::new();
    if !texture.is_empty() {
        let words: Vec<String> = texture.iter().map(|uv| format!("({}, {})", uv.x, uv.y)).collect();
        st = format!("    texCoord2f[] primvars:st = [{}] (\n        interpolation = \"faceVarying\"\n    )\n", words.join(", "));
    }
    format!(
        "#usda 1.0
(
    defaultPrim = \"Cloth\"
    endTimeCode = {samples}
    framesPerSecond = {fps}
    metersPerUnit = 1
    startTimeCode = 1
    timeCodesPerSecond = {fps}
    upAxis = \"{up:?}\"
)

def Mesh \"Cloth\"
{{
    uniform bool doubleSided = 1
    int[] faceVertexCounts = [{counts}]
    int[] faceVertexIndices = [{corners}]
    uniform token subdivisionScheme = \"none\"
{st}    point3f[] points.timeSamples = {{
"
    )
}
