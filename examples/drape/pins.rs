//! `--pin` of every example: vertices chosen by a rule or by number.

use std::str::FromStr;

use cloth_deformer::glam::{Vec2, Vec3};
use cloth_deformer::{Mesh, UpAxis};

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
    pub(crate) fn vertices(&self, mesh: &Mesh, up: UpAxis) -> Vec<u32> {
        match self {
            Pin::None => Vec::new(),
            Pin::Top => top(mesh, up),
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

/// The highest vertices; if the mesh is horizontal, its far side: that with the lowest z if y is up, the highest y if z is.
fn top(mesh: &Mesh, up: UpAxis) -> Vec<u32> {
    // Vertices within this share of the extent count as level, because modelers round coordinates.
    const LEVEL: f32 = 1e-4;
    let (low, high) = bounds(mesh);
    let extent = high - low;
    let along = |direction: Vec3| extent.dot(direction.abs());
    let (above, away) = (up.turn(Vec3::Y), up.turn(Vec3::NEG_Z));
    let toward = if along(above) > LEVEL * extent.max_element() { above } else { away };
    let far = low.dot(toward).max(high.dot(toward)) - LEVEL * along(toward);
    used(mesh).into_iter().filter(|&vertex| mesh.positions[vertex as usize].dot(toward) >= far).collect()
}

/// The vertices nearest to the corners of the mesh's bounding rectangle in the plane of its two largest extents.
fn corners(mesh: &Mesh) -> Vec<u32> {
    let (low, high) = bounds(mesh);
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| f32::total_cmp(&(high - low)[b], &(high - low)[a]));
    let across = |point: Vec3| Vec2::new(point[axes[0]], point[axes[1]]);
    let (low, high) = (across(low), across(high));
    let used = used(mesh);
    let nearest = |corner: Vec2| {
        let distance = |vertex: &u32| across(mesh.positions[*vertex as usize]).distance_squared(corner);
        used.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let rectangle = [low, Vec2::new(high.x, low.y), Vec2::new(low.x, high.y), high];
    let mut vertices: Vec<u32> = rectangle.into_iter().filter_map(nearest).collect();
    // In a small mesh one vertex may be nearest to several corners.
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// The corners of the bounding box (m) of the vertices that triangles use; the origin if the mesh is empty.
pub(crate) fn bounds(mesh: &Mesh) -> (Vec3, Vec3) {
    let mut used = used(mesh).into_iter().map(|vertex| mesh.positions[vertex as usize]);
    let first = used.next().unwrap_or_default();
    used.fold((first, first), |(low, high), position| (low.min(position), high.max(position)))
}

/// The vertices that triangles use, in order; all if there are no triangles. Files often have others beside a cloth.
fn used(mesh: &Mesh) -> Vec<u32> {
    if mesh.triangles.is_empty() {
        return (0..mesh.positions.len() as u32).collect();
    }
    let mut used = mesh.triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    used
}
