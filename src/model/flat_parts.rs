//! The connected parts of a cloth that lie exactly in a plane.

use glam::{DVec3, Vec4};

use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;

/// How far vertices may be out of a plane, as a share of the largest coordinate: a few times the rounding of single
/// precision.
const ROUNDING: f64 = 5e-7;

/// A part of a cloth that lies in a plane.
#[derive(Debug, Clone)]
pub(crate) struct FlatPart {
    pub normal: DVec3,
    pub vertices: Vec<u32>,
}

impl FlatPart {
    /// The largest coordinate (m) of any of its vertices, in proportion to which positions are rounded.
    pub(crate) fn size(&self, x: &[Vec4]) -> f64 {
        let coordinates = self.vertices.iter().map(|&vertex| x[vertex as usize].truncate().abs().max_element());
        f64::from(coordinates.fold(0.0, f32::max))
    }

    /// Whether its vertices at `x` are in a plane with this normal.
    pub(crate) fn is_flat(&self, x: &[Vec4]) -> bool {
        let height = |&vertex: &u32| x[vertex as usize].truncate().as_dvec3().dot(self.normal);
        let (first, most) = (height(&self.vertices[0]), ROUNDING * self.size(x));
        self.vertices.iter().all(|vertex| (height(vertex) - first).abs() <= most)
    }
}

/// The parts that are flat at `rest`.
pub(crate) fn flat_parts(rest: &[Vec4], triangles: &[[u32; 3]]) -> Vec<FlatPart> {
    let sides = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c]]);
    let part = DisjointSets::parts(rest.len(), sides);
    let at = |vertex: u32| rest[vertex as usize].truncate();
    let mut normal = vec![DVec3::ZERO; rest.len()];
    for &[a, b, c] in triangles {
        let [ab, ac] = [b, c].map(|end| (at(end) - at(a)).as_dvec3());
        let normal = &mut normal[part[a as usize] as usize];
        if *normal == DVec3::ZERO {
            *normal = ab.cross(ac).normalize_or_zero();
        }
    }
    let by_part = Csr::new(rest.len(), part.iter().copied().zip(0..));
    let parts = by_part
        .spans
        .iter()
        .zip(&normal)
        .filter(|(_, normal)| **normal != DVec3::ZERO)
        .map(|(span, &normal)| FlatPart { normal, vertices: by_part.items[span.start as usize..span.end as usize].to_vec() });
    parts.filter(|part| part.is_flat(rest)).collect()
}
