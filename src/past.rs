//! What an engine knows of a motion besides positions and displacements. Snapshots store it.

use crate::contact;
use crate::kernels::statistics::Statistics;
use crate::record::recorded;

/// What an engine knows of a motion besides positions and displacements.
#[derive(Debug, Clone, Default)]
pub(crate) struct Past {
    /// Number of good steps since the state was set.
    pub steps: u32,
    /// Statistics of steps that a GPU has taken and not returned yet.
    pub pending: Vec<Statistics>,
    /// State of the cloth's contact with itself.
    pub contact: Option<contact::ContactPast>,
}

recorded!(Past { steps, pending, contact });
