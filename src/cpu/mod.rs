//! The CPU engine: the solver's kernels, run on the threads of the current rayon pool.
//!
//! [`stages`] lists the stages of a substep in order, and [`substep`] says what each of them does. The cloth is cut
//! into tiles ([`partition`]). A stage becomes one task per tile, and the [`tasks`] scheduler orders tasks by the parts
//! of the cloth that they access.

mod backend;
mod bend_filter;
mod coarse;
mod correction;
mod edge_batches;
mod force_batches;
mod force_loops;
mod forces;
mod integrate;
mod packed;
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
pub(crate) use substep::{ExternalPrediction, StateView};
#[cfg(feature = "gpu")]
pub(crate) use tasks::shared::{MappedVectors, Task};
