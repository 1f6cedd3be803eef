//! The coarse levels of a cloth; the theory is in [`hierarchy`].

pub(crate) mod aggregation;
pub(crate) mod coarse_edges;
pub(crate) mod hierarchy;
mod unfolding;
