//! What a step asks of a GPU.

/// What a step asks of a GPU, counted: for a roofline beside measured times.
#[doc(hidden)]
#[cfg_attr(not(feature = "bench"), expect(unreachable_pub, reason = "the benches ask"))]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GpuStats {
    /// Dispatches that each wait for the one before.
    pub dispatches: usize,
    /// Bytes read and written if each dispatch reads what it needs once.
    pub bytes: usize,
    /// Colors that each wait for the one before, inside of dispatches.
    pub rounds: usize,
    /// Edges corrected in workgroup memory, those of halos in every tile that has them.
    pub edges: usize,
}
