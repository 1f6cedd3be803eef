//! A task scheduler, and the arrays that tasks share.

pub(crate) mod awake;
pub(crate) mod scheduler;
pub(crate) mod shared;
