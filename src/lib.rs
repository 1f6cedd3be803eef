//! stub
mod attributes;
mod cloth;
mod deformer;
mod error;
mod fabric;
mod mesh;
pub mod quality;

pub use attributes::{Attributes, Collider, Shape};
pub use deformer::{Backend, Deformer, Measure, Method, Options, Quality, StepReport, Warning};
pub use error::{BuildError, StepError};
pub use fabric::Fabric;
pub use glam;
pub use mesh::Mesh;
#[cfg(feature = "gpu")]
pub use wgpu;
