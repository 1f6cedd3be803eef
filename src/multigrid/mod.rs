//! The coarse levels of a cloth: [`hierarchy`] has the theory.

pub(crate) mod aggregation;
pub(crate) mod coarse_edges;
pub(crate) mod hierarchy;
