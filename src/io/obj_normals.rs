//! The normals of an OBJ, which turn with the polygons that they are on.

use std::collections::HashMap;
use std::ops::Range;

use glam::{Mat3, Vec3};

/// Normals that are as near as this at a vertex are one.
const SAME: f32 = 1e-3;

/// A face as the file has it.
pub(super) struct Face<'a> {
    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    pub corners: Vec<&'a str>,
    /// Vertices, texture coordinates and normals ahead of it, from which negative numbers count back.
    pub before: [usize; 3],
}

impl Face<'_> {
    /// Its vertices, from 0; the face was checked.
    pub(super) fn vertices(&self) -> Vec<u32> {
        self.corners.iter().filter_map(|corner| self.named(corner, 0, usize::MAX)).collect()
    }

    /// What a corner names as its vertex (0), its texture coordinate (1) or its normal (2), from 0.
    pub(super) fn named(&self, corner: &str, which: usize, count: usize) -> Option<u32> {
        let number = corner.split('/').nth(which)?.parse::<isize>().ok()?;
        let index = if number < 0 { self.before[which].checked_add_signed(number)? } else { number.checked_sub(1)? as usize };
        (index < count).then_some(index as u32)
    }
}

/// The normals of a file and the polygons' corners that have them.
#[derive(Debug, Clone)]
pub(super) struct Normals {
    /// Where in the file each is, and as it came.
    places: Vec<Range<usize>>,
    given: Vec<Vec3>,
    /// How each polygon lies at rest.
    rest: Vec<(Mat3, f32)>,
    /// Which normal, polygon and shared direction each corner has.
    corners: Vec<[u32; 3]>,
    /// Number of directions: of a normal at a vertex.
    directions: usize,
    is_shared: bool,
}

impl Normals {
    /// Of faces and their vertices. Corners without a normal have none here.
    pub(super) fn new(
        positions: &[Vec3],
        normals: Vec<(Range<usize>, Vec3)>,
        faces: &[Face<'_>],
        polygons: &[Vec<u32>],
    ) -> Normals {
        let (places, given): (Vec<_>, Vec<Vec3>) = normals.into_iter().unzip();
        let (mut corners, mut directions) = (Vec::new(), HashMap::new());
        let mut vertex_of = vec![u32::MAX; given.len()];
        let mut is_shared = false;
        for (index, (face, vertices)) in faces.iter().zip(polygons).enumerate() {
            for (&vertex, corner) in vertices.iter().zip(&face.corners) {
                let Some(normal) = face.named(corner, 2, given.len()) else { continue };
                let last = std::mem::replace(&mut vertex_of[normal as usize], vertex);
                is_shared |= last != u32::MAX && last != vertex;
                let rounded = given[normal as usize].to_array().map(|x| (x / SAME).round() as i32);
                let next = directions.len() as u32;
                let direction = *directions.entry((vertex, rounded)).or_insert(next);
                corners.push([normal, index as u32, direction]);
            }
        }
        let rest = polygons.iter().map(|polygon| frame(polygon, positions)).collect();
        Normals { places, given, rest, corners, directions: directions.len(), is_shared }
    }

    pub(super) fn places(&self) -> &[Range<usize>] {
        &self.places
    }

    pub(super) fn are_shared(&self) -> bool {
        self.is_shared
    }

    /// As they are where the vertices are at `positions` (m): each the mean, by area, of what it would be if it had turned with one
    /// polygon.
    pub(super) fn turned(&self, polygons: &[Vec<u32>], positions: &[Vec3]) -> Vec<Vec3> {
        let turn = |(polygon, (rest, rest_area)): (&Vec<u32>, &(Mat3, f32))| {
            let (now, area) = frame(polygon, positions);
            (now * rest.transpose(), if *rest_area > 0.0 { area } else { 0.0 })
        };
        let turns: Vec<(Mat3, f32)> = polygons.iter().zip(&self.rest).map(turn).collect();
        let mut directions = vec![Vec3::ZERO; self.directions];
        for &[normal, polygon, direction] in &self.corners {
            let (turn, area) = turns[polygon as usize];
            directions[direction as usize] += area * (turn * self.given[normal as usize]);
        }
        let mut sums = vec![Vec3::ZERO; self.given.len()];
        for &[normal, _, direction] in &self.corners {
            sums[normal as usize] += directions[direction as usize].normalize_or_zero();
        }
        let turned = |(sum, given): (&Vec3, &Vec3)| sum.try_normalize().map_or(*given, |unit| unit * given.length());
        sums.iter().zip(&self.given).map(turned).collect()
    }
}

/// How a polygon lies: its first side, across it and its normal, as columns; and twice its area (m²). Nothing turns one without area.
fn frame(polygon: &[u32], positions: &[Vec3]) -> (Mat3, f32) {
    let at = |corner: usize| positions[polygon[corner % polygon.len()] as usize];
    // Newell's method: the same for any polygon, flat or not.
    let area: Vec3 = (0..polygon.len()).map(|corner| (at(corner) - at(0)).cross(at(corner + 1) - at(0))).sum();
    let Some(normal) = area.try_normalize() else { return (Mat3::IDENTITY, 0.0) };
    let side = (0..polygon.len()).find_map(|corner| (at(corner + 1) - at(corner)).reject_from(normal).try_normalize());
    let side = side.unwrap_or_else(|| normal.any_orthonormal_vector());
    (Mat3::from_cols(side, normal.cross(side), normal), area.length())
}
