//! The solver on wgpu. All substeps of a step are encoded and submitted together, and nothing is read back unless asked
//! for.
//!
//! A [`Gpu`](crate::device::Gpu) lives as long as the program, a [`GpuEngine`] and its buffers as long as the cloth,
//! and a [`Plan`](crate::step::plan::Plan) for one step.
//!
//! On a large GPU a dependent dispatch takes about 2 us, whatever it does, so a step uses few of them. A small cloth,
//! or each cloth of a crowd, is stepped by one workgroup in one dispatch, including its forces
//! ([`sweep::SingleWorkgroup`]). A larger cloth is divided into [`tiles`] and swept in one dispatch per substep
//! ([`sweep::Tiled`]), after separate dispatches for what reaches beyond a tile: the [`forces`] of bending and wind,
//! and the coarse levels ([`multigrid`]). Tiles of a small cloth do these themselves where a pass of bending or a single level
//! is all. Within a dispatch a color takes 0.2 us if its edges are loaded in time, and
//! twice that if a lane has to wait for memory (see `shaders/stages/sweep.wgsl`). A mesh that cannot be divided takes a
//! dispatch per color ([`sweep::PerColor`]). A step works on copies, and is committed at its end if the [`watch`] found
//! no error, so a step that fails leaves the cloth unchanged.
//!
//! Contact of the cloth with itself runs after the sweep of each substep ([`contact`]). A step with it waits for the
//! GPU once.
//!
//! Modules import only modules before them in this order: `shaders`, `stage` and `submission` (a kernel and its buffers), `slices`,
//! `state`, `tiles` and `bend_tiles`, the stages of a substep (`bending`, `tethers`, `forces`, `multigrid`, `sweep`, `contact`), the end
//! of a step (`watch`, `commit`), output (`readback`, `statistics`, `surface`, `bound_mesh`), and `engine`.

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
mod submission;
mod surface;
mod sweep;
#[cfg(test)]
#[path = "../../tests/unit/gpu_routes.rs"]
mod tests;
mod tethers;
mod tiles;
mod watch;

pub use bound_mesh::BoundMesh;
pub(crate) use engine::GpuEngine;
pub(crate) use forces::Forces;
pub(crate) use stage::{Bind, ComputePass, Stage};
pub use surface::Surface;
