//! Gauges on the edges, by which the strain of a cloth is told while it moves.

use crate::kernels::statistics::{StrainGauge, WHOLE};
use crate::model::cloth::Cloth;
use crate::model::mesh::{EdgeIndex, edges, sides};

/// A gauge on each edge that is swept and that the fabric holds, weighed by the area of its triangles: slivers say little.
///
/// An edge whose stiffness is scaled below a half, for soft shear, has none: how far it stretches is the fabric's own affair.
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
        // A thread has no area; its edges are as stiff as with that of a square.
        let of_edge = if sides_of_all.get(index) == Some(&link.ends) { area[index] } else { 0.0 };
        let of_edge = if of_edge > 0.0 { of_edge } else { square };
        (link.shape > 0.5 * of_edge / square).then_some((link, of_edge))
    });
    let mut held: Vec<_> = held.collect();
    // In the order in which a pass over the vertices comes by.
    held.sort_unstable_by_key(|(link, _)| link.ends);
    let total: f64 = held.iter().map(|(_, area)| area).sum();
    let weight = |area: f64| (area / total * f64::from(WHOLE)).round() as u32;
    held.iter()
        .map(|(link, area)| StrainGauge { ends: link.ends, inverse_rest: 1.0 / link.rest, weight: weight(*area) })
        .collect()
}
