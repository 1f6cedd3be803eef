//! `--pin` of every example: vertices chosen by a rule or by number.

use std::str::FromStr;

use cloth_deformer::Mesh;
use cloth_deformer::glam::{Vec2, Vec3};

/// The choice of pinned vertices.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Pin {
    None,
    Top,
    Corners,
    Vertices(Vec<u32>),
}

impl Pin {
    /// Indices of the pinned vertices. Each occurs once, unless the user's own list repeats one.
    pub(crate) fn vertices(&self, mesh: &Mesh) -> Vec<u32> {
        match self {
            Pin::None => Vec::new(),
            Pin::Top => top(mesh),
            Pin::Corners => corners(mesh),
            Pin::Vertices(list) => list.clone(),
        }
    }
}

impl FromStr for Pin {
    type Err = String;

    fn from_str(text: &str) -> Result<Pin, String> {
        let index = |word: &str| {
            let word = word.trim();
            word.parse()
                .map_err(|_| format!("`{word}` is no vertex number; give none, top, corners or numbers from 0 with commas"))
        };
        match text {
            "none" => Ok(Pin::None),
            "top" => Ok(Pin::Top),
            "corners" => Ok(Pin::Corners),
            list => list.split(',').map(index).collect::<Result<Vec<u32>, String>>().map(Pin::Vertices),
        }
    }
}

/// The highest vertices; if the mesh is horizontal, the side with the lowest z.
fn top(mesh: &Mesh) -> Vec<u32> {
    // Vertices within this share of the extent count as level, because modelers round coordinates.
    const LEVEL: f32 = 1e-4;
    let (low, high) = bounds(mesh);
    let extent = high - low;
    let is_top = |position: &Vec3| {
        if extent.y > LEVEL * extent.max_element() {
            position.y >= high.y - LEVEL * extent.y
        } else {
            position.z <= low.z + LEVEL * extent.z
        }
    };
    (0..).zip(&mesh.positions).filter(|(_, position)| is_top(position)).map(|(vertex, _)| vertex).collect()
}

/// The vertices nearest to the corners of the mesh's bounding rectangle in the plane of its two largest extents.
fn corners(mesh: &Mesh) -> Vec<u32> {
    let (low, high) = bounds(mesh);
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| f32::total_cmp(&(high - low)[b], &(high - low)[a]));
    let across = |point: Vec3| Vec2::new(point[axes[0]], point[axes[1]]);
    let (low, high) = (across(low), across(high));
    let nearest = |corner: Vec2| {
        let distance = |position: &Vec3| across(*position).distance_squared(corner);
        (0..).zip(&mesh.positions).min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b))).map(|(vertex, _)| vertex)
    };
    let rectangle = [low, Vec2::new(high.x, low.y), Vec2::new(low.x, high.y), high];
    let mut vertices: Vec<u32> = rectangle.into_iter().filter_map(nearest).collect();
    // In a small mesh one vertex may be nearest to several corners.
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// The corners of the mesh's bounding box (m); the origin if the mesh is empty.
pub(crate) fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    let first = mesh.positions.first().copied().unwrap_or_default();
    mesh.positions.iter().fold((first, first), |(low, high), &position| (low.min(position), high.max(position)))
}
