//! The edges, visited color after color, then contact and the move: in three ways with one result.

pub(crate) mod forces_in_workgroup;
mod per_color;
mod single_workgroup;
mod tiled;

pub(crate) use per_color::PerColor;
pub(crate) use single_workgroup::SingleWorkgroup;
pub(crate) use tiled::Tiled;
