//! What the unit tests of the engines make plans from.

use super::*;

impl<'a> StepInputs<'a> {
    /// Of a step without levels.
    pub(crate) fn of(
        cloth: &'a Cloth,
        options: &'a Options,
        coefficients: &'a Coefficients,
        motion: &'a Motion,
        substeps: u32,
        attributes: &'a Attributes,
    ) -> StepInputs<'a> {
        StepInputs { cloth, levels: &[], lacks_levels: false, options, coefficients, motion, substeps, attributes }
    }
}
