//! What an engine reports when a step or a read did not work out.

/// Why a step or a read failed.
#[derive(Debug, Clone)]
pub(crate) enum Failure {
    /// The state is not finite from this vertex on, in the cloth's order.
    Unstable(usize),
    #[cfg(feature = "gpu")]
    Gpu(String),
}
