//! An edge of the cloth, with its rest length and stiffness.

use crate::model::csr::distinct;

/// How often a sweep visits an edge: see [`shells`](crate::model::shells).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Visits {
    #[default]
    Once,
    /// As all edges of a closed shell: in one order, and then in its reverse.
    ThereAndBack,
    /// As the diagonals of a tube: before all other edges, and after them in reverse order.
    FirstAndLast,
}

/// An edge of the cloth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Link {
    pub ends: [u32; 2],
    /// Rest length (m).
    pub rest: f32,
    /// Stiffness `(A1 + A2) / l0²` for K = 1 N/m, where K is that of firm edges ([`Cloth::stiffness`](crate::model::cloth::Cloth::stiffness)).
    pub shape: f64,
    /// Factor on the fabric's stiffness ([`Options::edge_scale`](crate::Options::edge_scale)). Of an edge between aggregates,
    /// the stiffness of the fabric along it as a share of what it would be if all edges were firm.
    pub scale: f32,
    pub visits: Visits,
}

impl Link {
    /// Whether the sweep visits the edge a second time.
    pub(crate) fn is_visited_twice(&self) -> bool {
        self.visits != Visits::Once
    }

    /// Whether the edge is firm, given the [`least_firm`] factor of the cloth. The stretch of softer ones, as for soft shear, is a
    /// property of the fabric: they have no strain gauges, and tethers do not measure distances along them.
    pub(crate) fn is_firm(&self, least: f32) -> bool {
        self.scale > 0.0 && self.scale >= least
    }
}

/// Edges, of which no two have the same vertices, in the order of these.
pub(crate) fn in_order(links: &[Link]) -> impl Iterator<Item = &Link> {
    let places = (0..).zip(links).map(|(place, &Link { ends: [a, b], .. })| [a, b, place]);
    distinct(places.collect()).into_iter().map(|[.., place]: [u32; 3]| &links[place as usize])
}

/// The factor of a cloth's firm edges: that of all if they agree, else 1, or the largest if no edge has half of that.
pub(crate) fn firm(scales: impl Iterator<Item = f32> + Clone) -> f32 {
    let [softest, stiffest] = [scales.clone().fold(f32::INFINITY, f32::min), scales.fold(0.0, f32::max)];
    if stiffest < 0.5 || softest == stiffest { stiffest } else { 1.0 }
}

/// The least factor of a firm edge.
pub(crate) fn least_firm(links: &[Link]) -> f32 {
    0.5 * firm(links.iter().map(|link| link.scale))
}
