//! What an engine reports when a step or a read did not work out.

/// Why a step or a read failed.
#[derive(Debug, Clone)]
pub(crate) enum Failure {
    /// The state is not finite from this vertex on, in the cloth's order.
    Unstable(usize),
    /// So many pairs of groups of triangles are too near for contact to look at.
    Crowded(usize),
    #[cfg(feature = "gpu")]
    Gpu(String),
}
