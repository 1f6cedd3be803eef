//! Updates the normals of an OBJ by rotating them with the polygons that use them.

use std::collections::HashMap;
use std::ops::Range;

use glam::{Mat3, Vec3};

/// Normals at a vertex whose components agree to this precision count as the same normal.
const SAME: f32 = 1e-3;

/// A face as written in the file.
pub(super) struct Face<'a> {
    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    pub corners: Vec<&'a str>,
    /// Number of vertices, texture coordinates and normals before it, from which negative indices count back.
    pub before: [usize; 3],
}

impl Face<'_> {
    /// Its vertices, from 0. The face was validated before.
    pub(super) fn vertices(&self) -> Vec<u32> {
        self.corners.iter().filter_map(|corner| self.named(corner, 0, usize::MAX)).collect()
    }

    /// The index, from 0, of a corner's vertex (`which` = 0), texture coordinate (1) or normal (2), if it has one below
    /// `count`.
    pub(super) fn named(&self, corner: &str, which: usize, count: usize) -> Option<u32> {
        let number = corner.split('/').nth(which)?.parse::<isize>().ok()?;
        let index = if number < 0 { self.before[which].checked_add_signed(number)? } else { number.checked_sub(1)? as usize };
        (index < count).then_some(index as u32)
    }
}

/// The normals of a file, and the corners of polygons that use them.
#[derive(Debug, Clone)]
pub(super) struct Normals {
    /// The place of each normal in the file, and its value there.
    pub places: Vec<Range<usize>>,
    given: Vec<Vec3>,
    /// The frame and twice the area of each polygon at rest: see [`frame`].
    rest: Vec<(Mat3, f32)>,
    /// Normal, polygon and direction of each corner. Corners that had the same normal at the same vertex share a
    /// direction.
    corners: Vec<[u32; 3]>,
    /// Number of directions.
    directions: usize,
    /// Whether a normal is used at several vertices.
    pub are_shared: bool,
}

impl Normals {
    /// `polygons` are the vertices of `faces`. Corners without a normal are skipped, and so are those whose normal is `None`.
    pub(super) fn new(
        positions: &[Vec3],
        normals: Vec<Option<(Range<usize>, Vec3)>>,
        faces: &[Face<'_>],
        polygons: &[Vec<u32>],
    ) -> Normals {
        // The index of each normal of the file among those that turn.
        let mut next = 0..;
        let turning: Vec<Option<u32>> = normals.iter().map(|normal| normal.as_ref().and_then(|_| next.next())).collect();
        let (places, given): (Vec<_>, Vec<Vec3>) = normals.into_iter().flatten().unzip();
        let (mut corners, mut directions) = (Vec::new(), HashMap::new());
        let mut vertex_of = vec![u32::MAX; given.len()];
        let mut are_shared = false;
        for (index, (face, vertices)) in faces.iter().zip(polygons).enumerate() {
            for (&vertex, corner) in vertices.iter().zip(&face.corners) {
                let named = face.named(corner, 2, turning.len());
                let Some(normal) = named.and_then(|normal| turning[normal as usize]) else { continue };
                let last = std::mem::replace(&mut vertex_of[normal as usize], vertex);
                are_shared |= last != u32::MAX && last != vertex;
                let rounded = given[normal as usize].to_array().map(|x| (x / SAME).round() as i32);
                let next = directions.len() as u32;
                let direction = *directions.entry((vertex, rounded)).or_insert(next);
                corners.push([normal, index as u32, direction]);
            }
        }
        let rest = polygons.iter().map(|polygon| frame(polygon, positions)).collect();
        Normals { places, given, rest, corners, directions: directions.len(), are_shared }
    }

    /// The normals for vertices at `positions` (m). Each is the area-weighted mean of what it would be if it had
    /// rotated with each polygon that uses it.
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

/// The orientation of a polygon, as the columns first side, perpendicular in its plane, and normal; and twice its area
/// (m²). A polygon without area has the identity.
fn frame(polygon: &[u32], positions: &[Vec3]) -> (Mat3, f32) {
    let at = |corner: usize| positions[polygon[corner % polygon.len()] as usize];
    // The sum over a fan of triangles, in which areas where a polygon is not convex cancel.
    let area: Vec3 = (0..polygon.len()).map(|corner| (at(corner) - at(0)).cross(at(corner + 1) - at(0))).sum();
    let Some(normal) = area.try_normalize() else { return (Mat3::IDENTITY, 0.0) };
    let side = (0..polygon.len()).find_map(|corner| (at(corner + 1) - at(corner)).reject_from(normal).try_normalize());
    let side = side.unwrap_or_else(|| normal.any_orthonormal_vector());
    (Mat3::from_cols(side, normal.cross(side), normal), area.length())
}
