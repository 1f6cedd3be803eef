//! Failures of a step or a read, as an engine reports them.

/// Why a step or a read failed.
#[derive(Debug, Clone)]
pub(crate) enum Failure {
    /// The motion became unstable in this step, counted since the state was last set. The cloth is as it was before the
    /// step.
    Unstable { cause: Defect, step: u32 },
    /// Contact found at least this many pairs, more than it can process.
    Crowded(usize),
    #[cfg(feature = "gpu")]
    Gpu(crate::device::fault::GpuFault),
}

#[cfg(feature = "gpu")]
impl From<crate::device::fault::GpuFault> for Failure {
    fn from(fault: crate::device::fault::GpuFault) -> Failure {
        Failure::Gpu(fault)
    }
}

/// What the stability check found, with indices in the solver's order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Defect {
    /// This vertex is out of bounds.
    Lost(usize),
    /// The cloth has more kinetic energy than the scene explains; this vertex is among the fast ones.
    Energy(usize),
    /// This edge, an index of `Cloth::links`, is too long.
    Edge(usize),
}
