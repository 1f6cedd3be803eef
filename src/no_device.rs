//! What stands for a device in a build without the `gpu` feature.

/// A wgpu device to compute on: none in a build without the `gpu` feature, so that [`Options::gpu`](crate::Options::gpu) is
/// always `None`. It is there so that what is written of [`Options`](crate::Options) compiles in both builds.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Gpu {}
