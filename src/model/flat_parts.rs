//! The connected parts of a cloth that lie exactly in a plane, or on a line.

use glam::{DVec3, Vec4};

use crate::model::cloth::Cloth;
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::mesh::bounds;

/// How far vertices may be from a plane or a line, as a share of the largest coordinate: a few times the rounding of single
/// precision.
const ROUNDING: f64 = 5e-7;

/// A part of a cloth that lies in a plane, or on a line.
pub(crate) struct FlatPart {
    pub normal: DVec3,
    /// The direction of the line, if it lies on one as a straight thread does. The normal is then any vector across it.
    pub line: Option<DVec3>,
    pub vertices: Vec<u32>,
    /// The longest side of its bounding box, and its largest coordinate (m).
    pub extent: f64,
    pub farthest: f64,
}

/// The parts of a cloth at `x` that are flat: those that triangles connect, and threads.
pub(crate) fn flat_parts(x: &[Vec4], cloth: &Cloth) -> Vec<FlatPart> {
    let Cloth { triangles, links, .. } = cloth;
    let mut is_corner = vec![false; x.len()];
    triangles.iter().flatten().for_each(|&corner| is_corner[corner as usize] = true);
    let threads = links.iter().map(|link| link.ends).filter(|ends| ends.iter().all(|&end| !is_corner[end as usize]));
    let part = DisjointSets::parts(x.len(), triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c]]).chain(threads));
    let at = |vertex: u32| x[vertex as usize].truncate().as_dvec3();
    // Twice the areas, all on one side: a sheet may be wound either way, or both.
    let mut normal = vec![DVec3::ZERO; x.len()];
    for &[a, b, c] in triangles {
        let (sum, area) = (&mut normal[part[a as usize] as usize], (at(b) - at(a)).cross(at(c) - at(a)));
        *sum += if area.dot(*sum) < 0.0 { -area } else { area };
    }
    let by_part = Csr::new(x.len(), part.iter().copied().zip(0..));
    let parts = by_part.lists().zip(normal).filter(|(vertices, _)| vertices.len() > 1).filter_map(|(vertices, normal)| {
        let [low, high] = bounds(vertices.iter().map(|&vertex| x[vertex as usize].truncate()));
        let farthest = f64::from(low.abs().max(high.abs()).max_element());
        let extent = f64::from((high - low).max_element());
        let part = |normal, line| FlatPart { normal, line, vertices: vertices.to_vec(), extent, farthest };
        let from_first = || vertices.iter().map(|&vertex| at(vertex) - at(vertices[0]));
        if let Some(normal) = normal.try_normalize() {
            return from_first().all(|to| to.dot(normal).abs() <= ROUNDING * farthest).then(|| part(normal, None));
        }
        let line = from_first().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?.try_normalize()?;
        let is_straight = from_first().all(|to| to.reject_from_normalized(line).length() <= ROUNDING * farthest);
        is_straight.then(|| part(line.any_orthonormal_vector(), Some(line)))
    });
    parts.collect()
}
