//! The kernels on the processor's threads.
//!
//! [`stages`] lists the stages of a substep in order, [`substep`] says what each does. The cloth is cut into tiles ([`partition`]); the
//! [`tasks`] of a stage, a tile each, are scheduled by what they touch.

mod backend;
mod bend_filter;
mod coarse;
mod edge_batches;
mod force_batches;
mod forces;
mod integrate;
mod partition;
mod schedule;
mod stages;
mod statistics;
mod substep;
mod sweep;
mod tasks;
mod tethers;
mod threads;
mod watch;

pub(crate) use backend::Cpu;
#[cfg(feature = "gpu")]
pub(crate) use substep::{Elsewhere, State};
#[cfg(feature = "gpu")]
pub(crate) use tasks::shared::{MappedVectors, SharedArray, Task};
