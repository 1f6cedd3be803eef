//! Data that does not change while the cloth moves: the mesh, its masses, edges and their colors, bending rows,
//! tethers.

pub(crate) mod bending;
pub(crate) mod checks;
pub(crate) mod cloth;
pub(crate) mod coloring;
pub(crate) mod csr;
pub(crate) mod disjoint_sets;
mod extents;
pub(crate) mod flat_parts;
pub(crate) mod link;
pub(crate) mod links;
mod masses;
pub(crate) mod mesh;
pub(crate) mod shells;
pub(crate) mod tethers;
pub(crate) mod vertex_order;
pub(crate) mod winding;
