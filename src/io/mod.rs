//! Reading and writing meshes and point caches.

pub(crate) mod atomic_file;
pub(crate) mod cache_form;
pub(crate) mod obj;
pub(crate) mod pc2_reader;
pub(crate) mod point_cache;
pub(crate) mod point_cache_error;
