//! Gauges on the edges, by which the strain of a moving cloth is measured.

use crate::kernels::statistics::{StrainGauge, WHOLE};
use crate::model::cloth::Cloth;
use crate::model::mesh::{EdgeIndex, edges, sides};

/// A gauge on each swept edge, weighted by the area of its triangles so that slivers count little.
///
/// Edges whose stiffness is scaled to less than a half, as for soft shear, have none: their stretch is a property of
/// the fabric.
pub(crate) fn strain_gauges(cloth: &Cloth) -> Vec<StrainGauge> {
    let sides_of_all = edges(&cloth.triangles);
    let index_of = EdgeIndex::new(&sides_of_all, cloth.rest.len());
    let mut area = vec![0.0; sides_of_all.len()];
    for &triangle in &cloth.triangles {
        let [a, b, c] = triangle.map(|vertex| cloth.rest[vertex as usize].truncate().as_dvec3());
        let triangle_area = 0.5 * (b - a).cross(c - a).length();
        sides(triangle).for_each(|side| area[index_of.of(side)] += triangle_area);
    }
    let held = cloth.swept().iter().filter_map(|link| {
        let index = index_of.of(link.ends);
        let square = f64::from(link.rest).powi(2);
        // A thread has no area; its edges count with the area of a square, as they do for their stiffness.
        let of_edge = if sides_of_all.get(index) == Some(&link.ends) { area[index] } else { 0.0 };
        let of_edge = if of_edge > 0.0 { of_edge } else { square };
        (link.shape > 0.5 * of_edge / square).then_some((link, of_edge))
    });
    let mut held: Vec<_> = held.collect();
    // In the order of the vertices, so that measuring reads memory sequentially.
    held.sort_unstable_by_key(|(link, _)| link.ends);
    let total: f64 = held.iter().map(|(_, area)| area).sum();
    let weight = |area: f64| (area / total * f64::from(WHOLE)).round() as u32;
    held.iter()
        .map(|(link, area)| StrainGauge { ends: link.ends, inverse_rest: 1.0 / link.rest, weight: weight(*area) })
        .collect()
}
