//! Guides, one page per task.
//!
//! - [`first_cloth`]: from a mesh to frames.
//! - [`moving_characters`]: moving colliders and pins.
//! - [`frame_rates`]: steps of any length, pausing, teleporting, saving.
//! - `drawing` (with the `gpu` feature): a renderer on the same GPU.
//! - [`which_method`]: which method, and how many substeps.
//! - [`when_it_goes_wrong`]: what warnings and errors mean.

#[doc = include_str!("first_cloth.md")]
pub mod first_cloth {}
#[doc = include_str!("moving_characters.md")]
pub mod moving_characters {}
#[doc = include_str!("frame_rates.md")]
pub mod frame_rates {}
#[cfg(feature = "gpu")]
#[doc = include_str!("drawing.md")]
pub mod drawing {}
#[doc = include_str!("which_method.md")]
pub mod which_method {}
#[doc = include_str!("when_it_goes_wrong.md")]
pub mod when_it_goes_wrong {}
