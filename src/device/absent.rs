//! Stands in for the GPU device in builds without the `gpu` feature.

/// A wgpu device. In a build without the `gpu` feature there is none: this type has no values, so
/// [`Options::gpu`](crate::Options::gpu) is always `None`, and code that sets [`Options`](crate::Options) compiles in
/// both builds.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Gpu {}
