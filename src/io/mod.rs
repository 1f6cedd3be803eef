//! Meshes and frames, in and out.

pub(crate) mod atomic_file;
pub(crate) mod obj;
pub(crate) mod pc2;
