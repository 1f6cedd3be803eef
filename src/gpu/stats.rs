//! The amount of work in a step on the GPU.

/// The amount of work in a step on the GPU, to compare measured times with a lower limit.
#[doc(hidden)]
#[cfg_attr(not(feature = "bench"), expect(unreachable_pub, reason = "the benches ask"))]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GpuStats {
    /// Dispatches, each of which waits for the previous one.
    pub dispatches: usize,
    /// Bytes read and written if each dispatch reads what it needs once.
    pub bytes: usize,
    /// Colors inside dispatches, each of which waits for the previous one.
    pub rounds: usize,
    /// Edges corrected in workgroup memory. Edges in halos count in every tile that has them.
    pub edges: usize,
}
