//! The cloth on wgpu: all substeps of a step in one encoder and one submit, nothing read back until asked for.
//!
//! A [`Gpu`](crate::device::Gpu) lives as long as the program, a [`GpuEngine`] and its buffers as long as the cloth, a
//! [`Plan`](crate::step::plan::Plan) for one step.
//!
//! In practice a dependent dispatch costs about 2 us on a large GPU, whatever it does, so a step is made of few. A small
//! cloth, or each of a crowd, is one workgroup's work, a step in one dispatch with all its forces ([`sweep::SingleWorkgroup`]). Any other is cut
//! into [`tiles`], a substep in one dispatch ([`sweep::Tiled`]); what looks farther comes before it in dispatches of its own:
//! the [`forces`] of bending and wind, and the coarse levels ([`multigrid`]). Inside of a dispatch a color costs .2 us if
//! its edges are there when it is their turn, and twice that if a lane has to wait for memory: see
//! `shaders/stages/sweep.wgsl`. A mesh that cannot be cut takes a dispatch a color ([`sweep::PerColor`]). A step works on
//! copies and is committed at its end if the [`watch`] finds nothing wrong with it, so a step that fails leaves the cloth as it was.
//!
//! With contact of the cloth with itself, its kernels come behind each substep's sweep ([`contact`]), and a step waits for the device once.
//!
//! Imports run down this list and never back: `shaders` and `stage` (a kernel and its buffers), `state` and `tiles`, the stages
//! of a substep (`forces`, `multigrid`, `sweep`, `contact`), what ends a step (`watch`, `commit`), what goes out (`readback`, `statistics`, `surface`, `bound_mesh`),
//! `engine`.

mod bend_tiles;
mod bending;
mod bound_mesh;
mod commit;
pub(crate) mod contact;
mod engine;
mod forces;
#[cfg(test)]
#[path = "../../tests/unit/gpu_layout.rs"]
mod layout;
mod multigrid;
mod readback;
pub(crate) mod shaders;
mod slices;
mod stage;
mod state;
mod statistics;
mod stats;
mod submission;
mod surface;
mod sweep;
#[cfg(test)]
#[path = "../../tests/unit/gpu_paths.rs"]
mod tests;
mod tethers;
mod tiles;
mod watch;

pub use bound_mesh::BoundMesh;
pub(crate) use bound_mesh::BoundVertex;
pub(crate) use engine::GpuEngine;
pub(crate) use forces::Forces;
pub(crate) use stage::{Bind, Stage};
#[cfg(feature = "bench")]
pub use stats::GpuStats;
pub use surface::Surface;
