//! Tasks on several threads, and the arrays that they share.

pub(crate) mod scheduler;
pub(crate) mod shared;
