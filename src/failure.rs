//! What an engine reports when a step or a read did not work out.

/// Why a step or a read failed.
#[derive(Debug, Clone)]
pub(crate) enum Failure {
    /// In this step since the state was last set; the cloth is as it was before it.
    Unstable { cause: Cause, step: u32 },
    /// So many pairs of groups of triangles are too near for contact to look at.
    Crowded(usize),
    #[cfg(feature = "gpu")]
    Gpu(crate::gpu_fault::GpuFault),
}

/// What a watch found, by the cloth's own numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    /// This vertex is out of bounds.
    Lost(usize),
    /// The cloth moves faster than anything explains, this vertex among others.
    Energy(usize),
    /// This edge is too long, by its place in `Cloth::links`.
    Edge(usize),
}
