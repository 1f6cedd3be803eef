//! A task scheduler, and the arrays that tasks share.

pub(crate) mod scheduler;
pub(crate) mod shared;
pub(crate) mod team;
