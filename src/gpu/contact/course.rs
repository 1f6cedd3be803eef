//! Chooses the kernels with which a step is attempted: only those that its start makes likely to be needed. If they do
//! not suffice, the step stops, is rolled back and is repeated with all kernels, with the same result bit for bit.

use super::status::Status;
use crate::contact::ahead_after;

/// Number of steps that run all kernels after a step that needed them.
const CAUTIOUS: u32 = 6;

/// The kernels of an attempt.
#[derive(Debug, Default)]
pub(super) struct Course {
    /// Whether the response runs. Without it, there must be no listed pairs.
    pub responds: bool,
    /// For each substep whether detection is expected; `None` if it may be due in any.
    expected: Option<Vec<bool>>,
    /// Number of steps left in which the response must run, and in which detection may be due in any substep.
    responding: u32,
    looking: u32,
}

impl Course {
    /// Chooses the kernels for the first attempt of a step that starts from `status`.
    pub(super) fn begin(&mut self, status: &Status, substeps: usize, vertices: usize) {
        self.responds = status.listed > 0 || self.responding > 0;
        self.responding = self.responding.saturating_sub(1);
        // A long list reduces how far detection looks ahead, which cannot be predicted.
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

    /// Chooses the kernels for the second attempt, after pairs were found without a response, or detection was due
    /// early.
    pub(super) fn change(&mut self, has_pairs: bool, is_early: bool) {
        if has_pairs {
            (self.responds, self.responding) = (true, CAUTIOUS);
        }
        if is_early {
            (self.expected, self.looking) = (None, CAUTIOUS);
        }
    }

    /// Whether a substep includes the kernels of detection.
    pub(super) fn looks(&self, substep: usize) -> bool {
        self.expected.as_ref().is_none_or(|expected| expected[substep])
    }
}
