//! Chooses the kernels with which a step is attempted: only those that its start makes likely to be needed. If they do
//! not suffice, the step stops, is rolled back and is repeated with more kernels, with the same result bit for bit.

use super::status::{CLOSE, EARLY, FAR_SPACING, SPACING, Status};

/// Number of steps that run the response, and number that may detect in any substep, after a step that needed to.
const CAUTIOUS: u32 = 6;
const WATCHFUL: u32 = 2;
/// Number of steps without more than one detection after which detection may be due less often.
const CALM: u32 = 6;
/// Number of calm steps that are not counted, after a step in which detection was due less often and therefore too late.
const WARY: u32 = 30;

/// What a step does about listed pairs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Response {
    /// Nothing: there must be none.
    #[default]
    None,
    /// Checks that none is near.
    Glance,
    /// Holds them apart.
    Full,
}

/// The kernels of an attempt.
#[derive(Debug, Default)]
pub(super) struct KernelChoice {
    pub response: Response,
    /// Detection may be due in every so many substeps.
    pub spacing: u32,
    /// Number of steps since the last one with more than one detection, and number of further ones that are not counted.
    calm_steps: u32,
    wary_for: u32,
    /// Number of steps left in which at least this response must run.
    at_least_for: u32,
    at_least: Response,
    /// Number of steps left in which detection may be due in any substep.
    detecting_for: u32,
}

impl KernelChoice {
    /// Chooses the kernels for the first attempt of a step of some substeps that starts from `status`.
    pub(super) fn begin(&mut self, status: &Status, substeps: usize) {
        self.response = match status {
            Status { near: 0, acting: 0, listed: 0, .. } => Response::None,
            Status { near: 0, acting: 0, .. } => Response::Glance,
            _ => Response::Full,
        };
        if self.at_least_for > 0 {
            self.response = self.response.max(self.at_least);
            self.at_least_for -= 1;
        }
        // If detection is nearly always due, there is no use in expecting that it is not.
        let is_frequent = 2 * (status.detections * SPACING) as usize > substeps;
        if status.detections > 1 {
            self.calm_steps = 0;
        } else if self.wary_for > 0 {
            self.wary_for -= 1;
        } else {
            self.calm_steps = self.calm_steps.saturating_add(1);
        }
        self.spacing = match self.calm_steps {
            _ if self.detecting_for > 0 || is_frequent => 1,
            CALM.. => FAR_SPACING.min(substeps as u32).max(SPACING),
            _ => SPACING,
        };
        self.detecting_for = self.detecting_for.saturating_sub(1);
    }

    /// Chooses the kernels for another attempt, after this one stopped; `has_pairs` says that pairs were found without
    /// room for them.
    pub(super) fn change(&mut self, stopped: u32, has_pairs: bool) {
        if stopped & CLOSE != 0 {
            self.need(Response::Full);
        } else if has_pairs && self.response == Response::None {
            self.need(Response::Glance);
        }
        if stopped & EARLY != 0 {
            if self.spacing > SPACING {
                (self.calm_steps, self.wary_for) = (0, WARY);
            }
            (self.spacing, self.detecting_for) = (1, WATCHFUL);
        }
    }

    fn need(&mut self, response: Response) {
        self.response = response;
        (self.at_least_for, self.at_least) = (CAUTIOUS, response);
    }

    /// Whether a substep includes the kernels of detection.
    pub(super) fn may_detect(&self, substep: usize) -> bool {
        substep.is_multiple_of(self.spacing as usize)
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/gpu_kernel_choice.rs"]
mod tests;
