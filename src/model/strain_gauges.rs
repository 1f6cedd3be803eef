//! Gauges on the edges, by which the strain of a moving cloth is measured.

use crate::kernels::statistics::{StrainGauge, WHOLE};
use crate::model::link::{Link, in_order, least_firm};

/// A gauge on each swept edge that is firm and has a length, weighted by the area of its triangles so that slivers count
/// little. A thread has no area; its edges count with the area of a square, as they do for their stiffness.
pub(crate) fn strain_gauges(swept: &[Link], has_length: impl Fn(&Link) -> bool) -> Vec<StrainGauge> {
    let area = |link: &Link| link.shape / f64::from(link.scale) * f64::from(link.rest).powi(2);
    let least = least_firm(swept);
    // In the order of the vertices, so that measuring reads memory sequentially.
    let held = in_order(swept).filter(|link| link.is_firm(least) && has_length(link));
    let held: Vec<_> = held.map(|link| (link, area(link))).collect();
    let total: f64 = held.iter().map(|(_, area)| area).sum();
    let weight = |area: f64| (area / total * f64::from(WHOLE)).round() as u32;
    held.iter()
        .map(|(link, area)| StrainGauge { ends: link.ends, inverse_rest: 1.0 / link.rest, weight: weight(*area) })
        .collect()
}
