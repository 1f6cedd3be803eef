//! What an engine reports when a step or a read did not work out.

/// See the module.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The state is not finite from this vertex on, in the cloth's order.
    Unstable(usize),
    #[cfg(feature = "gpu")]
    Gpu(String),
}
