#![doc = include_str!("../README.md")]

mod aggregates;
mod attributes;
mod bending;
mod cloth;
mod coarse;
mod coarse_edges;
mod coefficients;
mod coloring;
mod cpu;
mod crew;
mod deformer;
mod engine;
mod error;
mod fabric;
mod forces;
mod gathers;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(feature = "gpu")]
mod hybrid;
mod kernels;
mod lanes;
#[cfg(all(test, feature = "gpu"))]
mod layout;
mod levels;
mod lines;
mod measure;
mod mesh;
mod moves;
mod obj;
mod options;
mod packed;
mod pc2;
mod plan;
mod quality;
mod shared;
mod stripes;
mod whole;
mod wide;

pub use attributes::{Attributes, Collider, Shape};
pub use deformer::Deformer;
pub use error::{BuildError, StepError};
pub use fabric::Fabric;
pub use glam;
#[cfg(feature = "gpu")]
pub use gpu::{Gpu, GpuWork, Surface};
pub use measure::Measure;
pub use mesh::Mesh;
pub use obj::ObjError;
pub use options::{Backend, Levels, Method, Options, Quality, StepReport, Warning};
pub use pc2::{Pc2Error, PointCache};
#[cfg(feature = "gpu")]
pub use wgpu;
