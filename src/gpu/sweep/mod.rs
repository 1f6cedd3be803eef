//! The sweeps over the edges, color by color, followed by contact and the update of positions: three ways with the same
//! result.

pub(crate) mod forces_in_workgroup;
mod per_color;
mod rings;
mod single_workgroup;
mod tiled;

pub(crate) use per_color::PerColor;
#[cfg(test)]
pub(crate) use rings::with_rings;
pub(crate) use single_workgroup::SingleWorkgroup;
pub(crate) use tiled::{OnDemand, SweepInputs, Tiled};
