//! Turns a step into numbers, independently of the engine that runs it.

pub(crate) mod bending;
pub(crate) mod bodies;
pub(crate) mod coefficients;
pub(crate) mod controller;
pub(crate) mod levels;
pub(crate) mod load;
pub(crate) mod motion;
pub(crate) mod own_stretch;
pub(crate) mod pace;
pub(crate) mod plan;
pub(crate) mod substep_count;
pub(crate) mod watch;
