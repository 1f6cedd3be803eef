//! What the engines have in common of a motion besides its state: snapshots keep it, and go on from it.

use crate::contact;
use crate::kernels::statistics::Statistics;
use crate::record::recorded;

/// What an engine knows of the motion besides the state.
#[derive(Debug, Clone, Default)]
pub(crate) struct Past {
    /// Good steps since the state was set; and where the GPU's watch begins among the edges.
    pub steps: [u32; 2],
    /// Statistics of steps that a GPU has taken and not told of yet.
    pub untold: Vec<Statistics>,
    /// Contact of the cloth with itself.
    pub contact: Option<contact::Past>,
}

recorded!(Past { steps, untold, contact });
