//! How a step is tried: with as few kernels as its start lets one expect to be enough. Where they are not, the step stops, is taken back, and is
//! tried once more with all of them, to the same bits.

use super::status::Status;
use crate::contact::ahead_after;

/// Steps that are taken with all kernels after one that needed them.
const CAUTIOUS: u32 = 6;

/// Which kernels a step is tried with.
#[derive(Debug, Default)]
pub(super) struct Course {
    /// Whether pairs that are listed are held apart; else there may be none.
    pub responds: bool,
    /// The substeps in which detection is expected; `None` where it may come in any.
    expected: Option<Vec<bool>>,
    /// Steps left that are to respond, and to look in any substep.
    responding: u32,
    looking: u32,
}

impl Course {
    /// Of a step that begins there.
    pub(super) fn begin(&mut self, status: &Status, substeps: usize, vertices: usize) {
        self.responds = status.listed > 0 || self.responding > 0;
        self.responding = self.responding.saturating_sub(1);
        // How far a long list lets detection look ahead is not known beforehand.
        let is_known = self.looking == 0 && (status.listed as usize) < 2 * vertices;
        self.looking = self.looking.saturating_sub(1);
        let (mut since, mut ahead) = (status.since, status.ahead);
        let mut is_due = || {
            let is_due = since < 0.0 || since >= ahead;
            if is_due {
                ahead = ahead_after((since >= 0.0).then_some(since), ahead, false);
                since = 0.0;
            }
            since += 1.0;
            is_due
        };
        self.expected = is_known.then(|| (0..substeps).map(|_| is_due()).collect());
    }

    /// Of the same step once more, where there were pairs, or where detection was due before it was expected.
    pub(super) fn change(&mut self, has_pairs: bool, is_early: bool) {
        if has_pairs {
            (self.responds, self.responding) = (true, CAUTIOUS);
        }
        if is_early {
            (self.expected, self.looking) = (None, CAUTIOUS);
        }
    }

    /// Whether a substep has the kernels of detection.
    pub(super) fn looks(&self, substep: usize) -> bool {
        self.expected.as_ref().is_none_or(|expected| expected[substep])
    }
}
